"""The signatures of all effects at one fitted model, and which sets of them promise most.

A signature is what a small effect would do to the innovations. All of them are drawn once; whether one effect is asked
about, or two together, is then a matter of their inner products, without another pass over the log.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from diagnosis.evidence.marginal import Explanation
from diagnosis.evidence.prior import LOG_UNIFORM, forms
from diagnosis.linear import AT_ONCE, response
from diagnosis.nuisance import Nuisance
from identification.least_squares import bounded_least_squares
from identification.threads import in_threads
from plant.effects import Effect, Motion, Trace
from plant.effects.effect import Array

_FIRST = 6  # effects beside which a second is looked for
_CLOSER = 4  # shapes of an effect between whose neighbours it is looked again
_NEAR = 0.4  # share of the best shape's evidence that makes another a start of its own
_STARTS = 4
_RIDGE = 1e-10  # beside a scaled diagonal of ones
_ABSORBED = 1e-6  # of a signature, below which nothing of it is left


@dataclass(frozen=True, kw_only=True, eq=False)
class Signature:
    """One shape of an effect: the columns that are its own among all, and the effect that their sizes make."""

    name: str
    columns: slice
    positive: tuple[bool, ...]
    searched: int
    forms: int
    flexible: bool
    measured: tuple[str, ...]
    start: Callable[[Array], Effect]

    def excludes(self, other: Signature) -> bool:
        """Whether a model cannot have both: the same effect twice, or two motors before one load."""
        both_drive = self.flexible and other.flexible
        return self.name == other.name or both_drive or other.name in self.measured or self.name in other.measured


@dataclass(frozen=True, kw_only=True)
class Proposal:
    """A set of effects to add to a model, each with its starts, the best first.

    Attributes:
        value: log Bayes factor that it promises.
        worth: log Bayes factor by the log-likelihood that it brings.
        starts: of each effect.
        leads: whether nothing would promise more if there were no discrepancy.
    """

    value: float
    worth: Callable[[float], float]
    starts: tuple[tuple[Effect, ...], ...]
    leads: bool = False

    @property
    def names(self) -> frozenset[str]:
        """Of the effects."""
        return frozenset(starts[0].name for starts in self.starts)

    @property
    def chaotic(self) -> bool:
        """Whether one of them is."""
        return any(starts[0].chaotic for starts in self.starts)

    @property
    def costly(self) -> int:
        """How long a fit takes: 0 of one effect, 1 of two, 2 of what is chaotic."""
        return 2 if self.chaotic else len(self.starts) - 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Products:
    """Inner products of signatures, beyond what is taken over: (n, n) with one another, (n,) with the innovations."""

    gram: Array
    pull: Array
    power: float

    def beyond(self, columns: slice) -> Products:
        """Beyond some of the signatures themselves."""
        own = self.gram[columns, columns]
        size = np.sqrt(np.maximum(np.diag(own), 1e-300))
        inverse = np.linalg.pinv(own / np.outer(size, size), rcond=1e-9, hermitian=True) / np.outer(size, size)
        across = inverse @ self.gram[columns]
        return Products(
            gram=self.gram - self.gram[columns].T @ across,
            pull=self.pull - across.T @ self.pull[columns],
            power=self.power - float(self.pull[columns] @ inverse @ self.pull[columns]),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Signatures:
    """Of some effects at an explanation.

    Attributes:
        shapes: all of them.
        plain: products beyond the parameters.
        views: products beyond the parameters and the discrepancy: as large as it is, smaller, and without it; each with
            what the log says of a discrepancy of that size, against the one at hand.
        samples: N.
        catalogue: number of effects.
    """

    shapes: tuple[Signature, ...]
    plain: Products
    views: tuple[tuple[float, Products], ...]
    samples: int
    catalogue: int

    @classmethod
    def at(cls, explanation: Explanation, effects: Mapping[str, type[Effect]], catalogue: int) -> Signatures:
        """Draw them."""
        screen, discrepancy = explanation.screen, explanation.discrepancy
        parameters = Nuisance(own=discrepancy.own, shared=discrepancy.shared)
        left = parameters.beyond(screen.innovations)
        power = float(left @ left)
        shapes: list[Signature] = []

        def draw(traces: Iterable[tuple[str, Trace]]) -> Array:
            found: list[Array] = []
            first = shapes[-1].columns.stop if shapes else 0
            for some in _handfuls(traces):
                columns = np.hstack([trace.columns for _, trace in some])
                drawn = response(screen.filters, columns, on_reading=some[0][1].acts_on == "reading")
                with np.errstate(over="ignore", invalid="ignore"):
                    bounded = np.where(np.abs(drawn) < 1e100, -drawn, 0.0)
                found.append(parameters.beyond(bounded))
                for name, trace in some:
                    last = first + trace.columns.shape[1]
                    own = slice(first, last)
                    positive = trace.positive or (False,) * trace.columns.shape[1]
                    shapes.append(
                        Signature(
                            name=name,
                            columns=own,
                            positive=positive,
                            searched=trace.searched,
                            forms=forms(effects[name]),
                            flexible=effects[name].flexible,
                            measured=effects[name].measured,
                            start=trace.start,
                        )
                    )
                    first = last
            return np.hstack(found) if found else np.empty((left.size, 0))

        every = in_threads(lambda item: [(item[0], t) for t in item[1].traces(screen.motion)], effects.items())
        coarse = draw(pair for pair in chain.from_iterable(every) if pair[1].prior is None)
        first = Products(gram=coarse.T @ coarse, pull=coarse.T @ left, power=power)
        fine = draw(_closer(list(shapes), first, screen.motion))
        across = coarse.T @ fine
        plain = Products(
            gram=np.block([[first.gram, across], [across.T, fine.T @ fine]]),
            pull=np.concatenate((first.pull, fine.T @ left)),
            power=power,
        )
        columns = discrepancy.columns
        shared, along = np.hstack((columns.T @ coarse, columns.T @ fine)), columns.T @ left
        views = []
        for likelihood, weights in discrepancy.views():
            beside = Products(
                gram=plain.gram - shared.T @ weights @ shared,
                pull=plain.pull - shared.T @ (weights @ along),
                power=power - float(along @ weights @ along),
            )
            views.append((likelihood, beside))
        at_hand = max(likelihood for likelihood, _ in views)
        views = [(likelihood - at_hand, beside) for likelihood, beside in views]
        samples = explanation.fit.samples
        return cls(shapes=tuple(shapes), plain=plain, views=tuple(views), samples=samples, catalogue=catalogue)

    def proposals(self) -> list[Proposal]:
        """The sets of one or two effects, each with what it promises.

        Beside a discrepancy that has taken a missing effect over, the effect brings next to nothing. So each set is
        asked about beside discrepancies of several sizes, and has what it makes with the best of them.
        """
        best: dict[frozenset[str], Proposal] = {}
        for likelihood, products in self.views:
            ranked = self._ranked(products, likelihood)
            for proposal in ranked:
                at_hand = best.get(proposal.names)
                if at_hand is None or proposal.value > at_hand.value:
                    best[proposal.names] = proposal
        # In the last view, the one without discrepancy: the best effect, and the best two.
        by_size = ([each for each in ranked if len(each.names) == size] for size in (1, 2))
        leading = {max(some, key=lambda each: each.value).names for some in by_size if some}
        return [replace(each, leads=each.names in leading) for each in best.values()]

    def _ranked(self, products: Products, likelihood: float) -> list[Proposal]:
        """Each effect, and two of them where they promise more than either alone."""
        alone = self._best(products)
        found = [self._proposal(products, (shape,), likelihood + value) for value, shape in alone.values()]
        leading = sorted(alone.values(), key=lambda pair: -pair[0])[:_FIRST]
        for value, shape in leading:
            second = self._best(products.beyond(shape.columns), shape)
            for more, other in sorted(second.values(), key=lambda pair: -pair[0])[:_FIRST]:
                if more > 0.0 and (other.name not in alone or value + more > alone[other.name][0]):
                    found.append(self._proposal(products, (shape, other), likelihood + value + more))
        return found

    def _best(self, products: Products, beside: Signature | None = None) -> dict[str, tuple[float, Signature]]:
        """The best shape of each effect that explains anything, beside one perhaps, and what it promises.

        With signs left free a shape explains no less; so only those are looked at that might still be the best.
        """
        best: dict[str, tuple[float, Signature]] = {}
        most = _unbounded(products, self.plain, self.shapes)
        for place in np.argsort(-most, kind="stable"):
            shape, bound = self.shapes[place], float(most[place])
            if bound <= 0.0 or (beside is not None and shape.excludes(beside)):
                continue
            at_hand = best[shape.name][0] if shape.name in best else -np.inf
            if self._value(self._evidence(products, bound), shape) <= at_hand:
                continue
            explained = _explained(products, self.plain, shape, bound)
            value = self._value(self._evidence(products, explained), shape)
            if explained > 0.0 and value > at_hand:
                best[shape.name] = value, shape
        return best

    def _evidence(self, products: Products, explained: float) -> float:
        """Of an explained power."""
        return -0.5 * self.samples * float(np.log(max(1.0 - explained / max(products.power, 1e-300), 1e-12)))

    def _value(self, evidence: float, *shapes: Signature) -> float:
        """Of an evidence: less what the priors of the sizes, the search and the catalogue cost."""
        return evidence - sum(self._cost(evidence, shape) for shape in shapes)

    def _cost(self, evidence: float, shape: Signature) -> float:
        sizes = len(shape.positive)
        precise = 0.5 * float(np.log1p(2.0 * max(evidence, 0.0) / sizes))  # log of a size over its standard error
        searched = float(np.log(shape.searched)) + shape.forms * float(np.log(self.catalogue))
        return sizes * (precise + LOG_UNIFORM) + searched

    def _proposal(self, products: Products, shapes: tuple[Signature, ...], value: float) -> Proposal:
        places = np.concatenate([np.arange(s.columns.start, s.columns.stop) for s in shapes])
        positive = tuple(chain.from_iterable(s.positive for s in shapes))
        sizes = bounded_least_squares(products.gram[np.ix_(places, places)], products.pull[places], positive)
        starts, first = [], 0
        for shape in shapes:
            last = first + len(shape.positive)
            own = shape.start(sizes[first:last])
            starts.append((own, *self._others(products, shape)) if len(shapes) == 1 and own.multimodal else (own,))
            first = last
        return Proposal(value=value, worth=lambda gain: self._value(gain, *shapes), starts=tuple(starts))

    def _others(self, products: Products, best: Signature) -> Iterator[Effect]:
        """Other shapes of the same effect, nearly as good."""

        own = [best, *(shape for shape in self.shapes if shape.name == best.name and shape is not best)]
        evidence = [self._evidence(products, power) for power in _powers(products, self.plain, own)]
        least, like = _NEAR * evidence[0], list(zip(evidence[1:], own[1:], strict=True))
        near = sorted((pair for pair in like if pair[0] > least), key=lambda pair: -pair[0])
        for _, shape in near[: _STARTS - 1]:
            at = shape.columns
            yield shape.start(bounded_least_squares(products.gram[at, at], products.pull[at], shape.positive))


def _unbounded(products: Products, plain: Products, shapes: Sequence[Signature]) -> Array:
    """(S,) of the innovations' power that each shape explains where its sizes may have any sign."""
    found = np.zeros(len(shapes))
    widths = np.array([len(shape.positive) for shape in shapes])
    first = np.array([shape.columns.start for shape in shapes])
    for width in np.unique(widths):
        places = np.flatnonzero(widths == width)
        own = first[places, None] + np.arange(width)
        gram, pull = products.gram[own[:, :, None], own[:, None, :]], products.pull[own]
        left, whole = np.diagonal(gram, axis1=1, axis2=2), np.diag(plain.gram)[own]
        sound = (left > _ABSORBED * whole).all(axis=1)
        size = np.sqrt(left[sound])
        scaled = gram[sound] / (size[:, :, None] * size[:, None, :]) + _RIDGE * np.eye(width)
        along = pull[sound] / size
        found[places[sound]] = np.einsum("sw,sw->s", along, np.linalg.solve(scaled, along[:, :, None])[:, :, 0])
    return found


def _powers(products: Products, plain: Products, shapes: Sequence[Signature]) -> list[float]:
    """(S,) of the innovations' power that each shape explains."""
    most = _unbounded(products, plain, shapes)
    return [_explained(products, plain, shape, float(free)) for shape, free in zip(shapes, most, strict=True)]


def _explained(products: Products, plain: Products, shape: Signature, free: float) -> float:
    """Of the innovations' power by one signature; nothing by one that the others have absorbed.

    Where its sizes may have any sign, that is what it explains with signs left free.
    """
    if not any(shape.positive):
        return free
    own = shape.columns
    gram, pull = products.gram[own, own], products.pull[own]
    if np.any(np.diag(gram) <= _ABSORBED * np.diag(plain.gram[own, own])):
        return 0.0
    if len(pull) == 1:
        return 0.0 if shape.positive[0] and pull[0] <= 0.0 else float(pull[0] ** 2 / gram[0, 0])
    sizes = bounded_least_squares(gram, pull, shape.positive)
    return float(2.0 * pull @ sizes - sizes @ gram @ sizes)


def _closer(shapes: Sequence[Signature], products: Products, motion: Motion) -> Iterator[tuple[str, Trace]]:
    """Traces between those that promise most, of each effect."""
    by_name: dict[str, list[tuple[float, Signature]]] = {}
    for power, shape in zip(_powers(products, products, shapes), shapes, strict=True):
        by_name.setdefault(shape.name, []).append((power, shape))
    for name, own in by_name.items():
        for _, shape in sorted(own, key=lambda pair: -pair[0])[:_CLOSER]:
            at = shape.columns
            sizes = bounded_least_squares(products.gram[at, at], products.pull[at], shape.positive)
            for trace in shape.start(sizes).closer(motion):
                yield name, trace


def _handfuls(traces: Iterable[tuple[str, Trace]]) -> Iterator[list[tuple[str, Trace]]]:
    """A few at a time: as many columns as are followed at once, those of torques and of the measurement apart."""
    some: list[tuple[str, Trace]] = []
    for name, trace in traces:
        full = sum(t.columns.shape[1] for _, t in some) + trace.columns.shape[1] > AT_ONCE
        if some and (full or trace.acts_on != some[0][1].acts_on):
            yield some
            some = []
        some.append((name, trace))
    if some:
        yield some
