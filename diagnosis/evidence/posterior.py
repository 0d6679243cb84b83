"""The joint posterior over sets of effects, and the probability of each effect.

No set is exact. Model errors are correlated over many samples, but the evidence counts the samples as independent. So
the blocks of the log are resampled (Bayesian bootstrap): with Dirichlet weights z of the blocks a set k has

    log Z_k(z) = log Z_k + sum_b (z_b - 1) log p(block b | k),

and its probability is the average over z (pseudo-BMA+; Yao, Vehtari, Simpson and Gelman 2018). The probability is close
to one only if nearly all blocks favour the set.

The log-likelihood that an effect loses on validation data is resampled in the same way and subtracted from every set
with the effect: validation data can lower the probability of an effect, never raise it.

An effect that is significant, but smaller than the unexplained part, may be a part of it. So an effect keeps

    r^2 / (1 + r^2)

of its probability. Here r is its change of the innovations, divided by that of the discrepancy and the non-parametric
effects, or by a hundredth of the largest other effect (the error of that one's law), whichever is larger. Where other
terms cancel most of an effect, it also keeps only the probability that what is left is more than a normal error of a
hundredth of these. The rest goes to the same set without it. An effect with a simpler special case is tested a second
time: what it adds to the special case has to exceed the same, and a hundredth of the effect itself.

The same rule holds for a set with a non-parametric effect, compared with the most probable set of catalogue effects
alone: what it explains beyond that set has to exceed a hundredth of the largest effect there.

No model of the unmodelled torque is right either, so all this is still too sure. What is reported is the posterior
raised to a power below one, the learning rate (Bissiri, Holmes and Walker 2016; Gruenwald and van Ommen 2017).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

import numpy as np

from diagnosis.evidence.marginal import Explanation
from diagnosis.jackknife import BLOCKS
from diagnosis.levels import INEXACT, LEARNING_RATE, LIKELY
from plant.effects import catalogue
from plant.effects.effect import Array
from plant.effects.nonparametric import unnamed

_NEGLIGIBLE = 1e-4  # probability below which a set is not divided any further
_DRAWS = 1000  # of the block weights
_LARGEST_RATIO = 1e6  # largest ratio, against overflow


@dataclass(frozen=True, kw_only=True, eq=False)
class Posterior:
    """Posterior over sets of effects.

    Attributes:
        sets: the fitted sets, in order of decreasing evidence.
        probabilities: of each set, by the evidence alone, averaged over the resampled blocks.
        reported: probability of each set after the size rules, the most probable set first.
    """

    sets: tuple[Explanation, ...]
    probabilities: tuple[float, ...]
    reported: Mapping[frozenset[str], float]

    @classmethod
    def over(cls, explanations: Iterable[Explanation], against: Mapping[str, Array] | None = None) -> Posterior:
        """Posterior over all sets; `against` has for effects the (B,) change of log-likelihood on validation data."""
        ordered = sorted(explanations, key=lambda each: -each.log_marginal)
        probabilities = tuple(over_blocks(ordered, against or {}).tolist())
        reported: dict[frozenset[str], float] = {}
        named = next((each for each in ordered if each.names.isdisjoint(unnamed)), None)
        for each, p in zip(ordered, probabilities, strict=True):
            kept = 1.0 if named is None else beside_names(each, named)
            parts = [(each, p * kept), *([(named, p * (1.0 - kept))] if named is not None and kept < 1.0 else [])]
            for names, share in chain.from_iterable(beside_discrepancy(*part).items() for part in parts):
                reported[names] = reported.get(names, 0.0) + share
        ranked = dict(sorted(reported.items(), key=lambda item: -item[1]))
        return cls(sets=tuple(ordered), probabilities=probabilities, reported=ranked)

    @cached_property
    def tempered(self) -> Posterior:
        """The same with the probabilities to report, which are less extreme by the learning rate."""
        powers = {names: p**LEARNING_RATE for names, p in self.reported.items()}
        whole = sum(powers.values())
        return replace(self, reported={names: power / whole for names, power in powers.items()})

    @cached_property
    def leading(self) -> frozenset[str]:
        """The effects with a probability above 0.5 (median probability model; Barbieri and Berger 2004).

        If the probability that further effects are missing exceeds 0.5, it is the most probable set that contains
        these effects: of confounded effects each may have a low probability, although one of them is present. Effects
        that exceed 0.5 by the evidence alone are minor and are not added.
        """
        names = frozenset(name for each in self.reported for name in each)
        probable = frozenset(name for name in names if self.probability(name) > LIKELY)
        minor = frozenset(name for name in names - probable if self.of(name) > LIKELY)
        holding = [each for each in self.reported if probable <= each and not each & minor]
        return probable if self.complete(probable | minor) > LIKELY or not holding else holding[0]

    @cached_property
    def best(self) -> Explanation:
        """The fit of the leading set; else the best fit of a set that contains it; else the best of all."""
        holding = [each for each in self.sets if self.leading <= each.names]
        exact = [each for each in holding if each.names == self.leading]
        return (exact or holding or self.sets)[0]

    def of(self, name: str) -> float:
        """Posterior probability of an effect by the evidence alone: the sum over all sets with it."""
        return sum(p for each, p in zip(self.sets, self.probabilities, strict=True) if name in each.names)

    def probability(self, name: str) -> float:
        """Posterior probability of an effect after the size rules."""
        return sum(p for names, p in self.reported.items() if name in names)

    def complete(self, kept: Collection[str]) -> float:
        """Probability that no effect is missing from `kept`; an effect with a special case in `kept` is not missing."""
        return sum(p for names, p in self.reported.items() if all(special_cases(n) & {*kept} for n in names))

    def names(self) -> dict[str, float]:
        """Each catalogue effect with its probability by the evidence alone, the most probable first."""
        every = {name for names in self.reported for name in names.difference(unnamed)}
        return dict(sorted(((name, self.of(name)) for name in every), key=lambda item: -item[1]))

    def nonparametric(self, kinds: Collection[str] = tuple(unnamed)) -> float:
        """Probability that non-parametric effects of some kinds are in the set."""
        return sum(p for names, p in self.reported.items() if not names.isdisjoint(kinds))


def special_cases(name: str) -> set[str]:
    """An effect and its special cases."""
    kind = catalogue.get(name)
    return {name, *(() if kind is None else kind.contains)}


def over_blocks(sets: Sequence[Explanation], against: Mapping[str, Array]) -> Array:
    """(S,) probabilities of sets, averaged over random weights of the blocks of the log."""
    draw = np.random.default_rng(0)

    def again(count: int) -> Array:
        return np.asarray(draw.dirichlet(np.ones(count), size=_DRAWS) * count)

    blocks = np.array([each.likelihood.by_block(BLOCKS) for each in sets])
    scores = np.array([each.log_marginal for each in sets]) + (again(BLOCKS) - 1.0) @ blocks.T
    for name, differences in sorted(against.items()):
        taken = np.minimum(again(differences.size) @ differences, 0.0)
        scores += np.outer(taken, [name in each.names for each in sets])
    weights = np.exp(scores - scores.max(axis=1, keepdims=True))
    return np.asarray(np.mean(weights / weights.sum(axis=1, keepdims=True), axis=0))


def beside_discrepancy(explanation: Explanation, probability: float) -> dict[frozenset[str], float]:
    """The subsets that remain if effects are attributed to the discrepancy, with their shares of the probability.

    The smallest effect is tested first: without it, an effect that is confounded with it is larger. If the discrepancy
    is at its largest amplitude, the fit has failed; then an effect keeps at most half of its probability, for it may
    only be the best available approximation.
    """
    found: dict[frozenset[str], float] = {}
    sound = LIKELY if explanation.discrepancy.posterior.at_its_limit else 1.0

    def ask(left: frozenset[str], kept: frozenset[str], out: frozenset[str], p: float) -> None:
        if not left or p < _NEGLIGIBLE:
            found[kept | left] = found.get(kept | left, 0.0) + p
            return
        sizes = {name: explanation.sizes.beyond(name, out) for name in sorted(left)}
        name = min(sizes, key=lambda each: sizes[each])
        kept_size = kept_share(sizes[name], explanation.sizes.to_exceed(name)) * explanation.sizes.is_left(name, out)
        whole = wide = sound * kept_size
        if name in explanation.sizes.beyond_special:
            special, more = explanation.sizes.beyond_special[name]
            wide = whole * kept_share(more, max(explanation.sizes.to_exceed(name), INEXACT * sizes[name]))
            simple = kept if special is None else kept | {special}  # an excluded special case is not reported
            ask(left - {name}, simple, out, p * (whole - wide))
        ask(left - {name}, kept | {name}, out, p * wide)
        ask(left - {name}, kept, out | {name}, p * (1.0 - whole))

    instead = explanation.names.intersection(unnamed)
    ask(explanation.names - instead, instead, frozenset(), probability)
    return found


def beside_names(explanation: Explanation, named: Explanation) -> float:
    """Share of its probability that a set with a non-parametric effect keeps against the best set without any.

    The size of what it explains beyond that set follows from the gain in log-likelihood, without the penalty for the
    number of effects: a change d of the innovations gains d^2 / (2 s^2).
    """
    laws = [size for size in named.sizes.effects.values() if np.isfinite(size)]
    if explanation.names.isdisjoint(unnamed) or not laws:
        return 1.0
    more = max(explanation.likelihood.log_likelihood - named.likelihood.log_likelihood, 0.0)
    return kept_share(float(np.sqrt(2.0 * more * named.discrepancy.posterior.variance)), INEXACT * max(laws))


def kept_share(size: float, beside: float) -> float:
    """Share of its probability that an effect keeps [-], from its size and the size it has to exceed [rad]."""
    ratio = min(size / max(beside, 1e-300), _LARGEST_RATIO)
    return float(ratio**2 / (1.0 + ratio**2))
