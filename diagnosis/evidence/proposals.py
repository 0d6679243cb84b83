"""The sets of one or two added effects with the highest linearised evidence, and the starts of their fits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from diagnosis.evidence.explained_power import Products, Signature, explained, powers, unbounded
from diagnosis.evidence.prior import LOG_UNIFORM
from diagnosis.evidence.signatures import Signatures
from diagnosis.levels import LIKELY
from identification.least_squares import bounded_least_squares
from plant.effects import Effect

_FIRST = 6  # effects to which a second one is added
_STARTS = 4


@dataclass(frozen=True, kw_only=True)
class Proposal:
    """A set of effects to add to a model, each with its starts, the best first.

    Attributes:
        value: linearised evidence, a log Bayes factor.
        evidence: log Bayes factor as a function of the gain in log-likelihood.
        starts: of each effect.
        leads: whether its linearised evidence without discrepancy is the highest of its number of effects.
    """

    value: float
    evidence: Callable[[float], float]
    starts: tuple[tuple[Effect, ...], ...]
    leads: bool = False

    @property
    def names(self) -> frozenset[str]:
        """Names of the effects."""
        return frozenset(starts[0].name for starts in self.starts)

    @property
    def chaotic(self) -> bool:
        """Whether one of the effects is chaotic."""
        return any(starts[0].chaotic for starts in self.starts)

    @property
    def costly(self) -> int:
        """Class of computing time: 0 for one effect, 1 for two, 2 for a chaotic effect."""
        return 2 if self.chaotic else len(self.starts) - 1


def proposals_of(signatures: Signatures) -> list[Proposal]:
    """The sets of one or two effects, each with its linearised evidence.

    A discrepancy that has absorbed a missing effect hides it. So the linearised evidence is calculated with
    discrepancies of several sizes, and the highest value counts.
    """
    best: dict[frozenset[str], Proposal] = {}
    for likelihood, products in signatures.views:
        ranked = _Ranking(signatures=signatures, products=products).proposals(likelihood)
        for proposal in ranked:
            at_hand = best.get(proposal.names)
            if at_hand is None or proposal.value > at_hand.value:
                best[proposal.names] = proposal
    # In the last view, the one without discrepancy: the best effect, and the best two.
    by_size = ([each for each in ranked if len(each.names) == size] for size in (1, 2))
    leading = {max(some, key=lambda each: each.value).names for some in by_size if some}
    return [replace(each, leads=each.names in leading) for each in best.values()]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Ranking:
    """Ranking by the power that the signatures explain, with one size of the discrepancy."""

    signatures: Signatures
    products: Products

    def proposals(self, likelihood: float) -> list[Proposal]:
        """Each effect, and pairs of effects whose linearised evidence exceeds that of either alone."""
        alone = self._best(self.products)
        found = [self._proposal((shape,), likelihood + value) for value, shape in alone.values()]
        leading = sorted(alone.values(), key=lambda pair: -pair[0])[:_FIRST]
        for value, shape in leading:
            second = self._best(self.products.beyond(shape.columns), shape)
            for more, other in sorted(second.values(), key=lambda pair: -pair[0])[:_FIRST]:
                if more > 0.0 and (other.name not in alone or value + more > alone[other.name][0]):
                    found.append(self._proposal((shape, other), likelihood + value + more))
        return found

    def _best(self, products: Products, beside: Signature | None = None) -> dict[str, tuple[float, Signature]]:
        """The best shape of each effect and its linearised evidence, optionally in addition to another effect.

        The power without sign constraints is an upper bound; shapes below the best so far by this bound are skipped.
        """
        best: dict[str, tuple[float, Signature]] = {}
        most = unbounded(products, self.signatures.plain, self.signatures.shapes)
        for place in np.argsort(-most, kind="stable"):
            shape, bound = self.signatures.shapes[place], float(most[place])
            hopeless = bound <= 0.0 and not shape.kind.chaotic
            if hopeless or (beside is not None and shape.kind.excludes(beside.kind)):
                continue
            at_hand = best[shape.name][0] if shape.name in best else -np.inf
            if self._value(self._evidence(products, bound), shape) <= at_hand:
                continue
            power = explained(products, self.signatures.plain, shape, bound)
            value = self._value(self._evidence(products, power), shape)
            if (power > 0.0 or shape.kind.chaotic) and value > at_hand:
                best[shape.name] = value, shape
        return best

    def _evidence(self, products: Products, power: float) -> float:
        """Gain in log-likelihood by an explained power."""
        return -0.5 * self.signatures.samples * float(np.log(max(1.0 - power / max(products.power, 1e-300), 1e-12)))

    def _value(self, evidence: float, *shapes: Signature) -> float:
        """The gain in log-likelihood less the costs of the priors, of the compared shapes and of the catalogue."""
        return evidence - sum(self._cost(evidence, shape) for shape in shapes)

    def _cost(self, evidence: float, shape: Signature) -> float:
        sizes = len(shape.positive)
        precise = 0.5 * float(np.log1p(2.0 * max(evidence, 0.0) / sizes))  # log of a size over its standard error
        searched = float(np.log(shape.searched)) + shape.forms * float(np.log(self.signatures.catalogue))
        return sizes * (precise + LOG_UNIFORM) + searched

    def _proposal(self, shapes: tuple[Signature, ...], value: float) -> Proposal:
        places = np.concatenate([np.arange(s.columns.start, s.columns.stop) for s in shapes])
        positive = tuple(chain.from_iterable(s.positive for s in shapes))
        sizes = bounded_least_squares(self.products.gram[np.ix_(places, places)], self.products.pull[places], positive)
        starts, first = [], 0
        for shape in shapes:
            last = first + len(shape.positive)
            own = shape.start(sizes[first:last])
            starts.append((own, *self._others(shape)) if len(shapes) == 1 and own.multimodal else (own,))
            first = last
        return Proposal(value=value, evidence=lambda gain: self._value(gain, *shapes), starts=tuple(starts))

    def _others(self, best: Signature) -> Iterator[Effect]:
        """Other shapes of the same effect, nearly as good; of a chaotic effect all, as its signature says little."""
        products, shapes = self.products, self.signatures.shapes
        own = [best, *(shape for shape in shapes if shape.name == best.name and shape is not best)]
        if best.kind.chaotic:
            yield from (shape.start(np.ones(len(shape.positive))) for shape in own)
            return
        evidence = [self._evidence(products, power) for power in powers(products, self.signatures.plain, own)]
        least, like = LIKELY * evidence[0], list(zip(evidence[1:], own[1:], strict=True))
        near = sorted((pair for pair in like if pair[0] > least), key=lambda pair: -pair[0])
        for _, shape in near[: _STARTS - 1]:
            at = shape.columns
            yield shape.start(bounded_least_squares(products.gram[at, at], products.pull[at], shape.positive))
