"""The joint posterior over sets of effects, and what may be said of each name.

No set is exact, and what is wrong with one is wrong for many samples on end, which the evidence counts as if each were
news. So the log is drawn again: with Dirichlet weights z of its blocks a set k has

    log Z_k(z) = log Z_k + sum_b (z_b - 1) log p(block b | k),

and its probability is the average over z (pseudo-BMA+; Yao, Vehtari, Simpson and Gelman 2018). It is sure where nearly
all blocks speak for it.

What validation data say against an effect, block by block, is drawn again likewise, and taken from every set that holds
it: they can make a name less likely, never more.

What is significant, but smaller than what no name explains, may well be a part of that. So a name keeps

    r^2 / (1 + r^2)

of its probability, with r what it changes in the innovations over what has no name does there, or over a
hundredth of the largest other effect, which that one's law may be wrong by; the rest goes to the same set without it.
An effect that has a simpler one as its special case is asked twice: what it adds to that has to exceed a hundredth of
itself. Whether a discrepancy explains it as well is asked by the evidence alone.

Likewise a set with something that has no name keeps as much beside the likeliest set of names alone: what it explains
beyond that has to exceed a hundredth of the largest effect there.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np

from diagnosis.evidence.marginal import Explanation
from diagnosis.jackknife import BLOCKS
from diagnosis.levels import INEXACT, LIKELY
from plant.effects import catalogue
from plant.effects.effect import Array
from plant.effects.nonparametric import unnamed

_NEGLIGIBLE = 1e-4  # probability of a set that is not weighed against the discrepancy any further
_DRAWS = 1000  # of the blocks
_SURELY = 1e6  # ratio that is as good as any larger one


@dataclass(frozen=True, kw_only=True, eq=False)
class Posterior:
    """Over sets.

    Attributes:
        sets: as they were fitted, the likeliest first.
        probabilities: of each, by the evidence alone, averaged over the blocks drawn again.
        reported: sets of names, the likeliest first, with what remains of each beside the discrepancy.
    """

    sets: tuple[Explanation, ...]
    probabilities: tuple[float, ...]
    reported: Mapping[frozenset[str], float]

    @classmethod
    def over(cls, explanations: Iterable[Explanation], against: Mapping[str, Array] | None = None) -> Posterior:
        """Of all that were weighed; `against` has (B,) log-likelihoods by which validation data speak against names."""
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
    def leading(self) -> frozenset[str]:
        """The names that are likelier there than not, which predict best together.

        (The median probability model; Barbieri and Berger 2004.) Where more than these is missing likelier than not,
        the likeliest set that holds them: of look-alikes none may be likely by itself, but one of them is there. What
        is likely by the evidence alone is minor, and no more.
        """
        names = frozenset(name for each in self.reported for name in each)
        likely = frozenset(name for name in names if self.probability(name) > LIKELY)
        minor = frozenset(name for name in names - likely if self.of(name) > LIKELY)
        holding = [each for each in self.reported if likely <= each and not each & minor]
        return likely if self.complete(likely | minor) > LIKELY or not holding else holding[0]

    @cached_property
    def best(self) -> Explanation:
        """The fit of the leading set; where it is not among the fits, the likeliest that holds its names, or any."""
        holding = [each for each in self.sets if self.leading <= each.names]
        exact = [each for each in holding if each.names == self.leading]
        return (exact or holding or self.sets)[0]

    def of(self, name: str) -> float:
        """Probability that an effect is there by the evidence alone: of all sets that hold it together."""
        return sum(p for each, p in zip(self.sets, self.probabilities, strict=True) if name in each.names)

    def probability(self, name: str) -> float:
        """Probability that an effect is there, and no part of what no name explains."""
        return sum(p for names, p in self.reported.items() if name in names)

    def complete(self, told: Collection[str]) -> float:
        """Probability that nothing is missing beside some names, wider forms of them aside."""
        return sum(p for names, p in self.reported.items() if all(special_cases(n) & {*told} for n in names))

    def names(self) -> dict[str, float]:
        """Each name with its probability by the evidence alone, the likeliest first."""
        every = {name for names in self.reported for name in names.difference(unnamed)}
        return dict(sorted(((name, self.of(name)) for name in every), key=lambda item: -item[1]))

    def nameless(self, kinds: Collection[str] = tuple(unnamed)) -> float:
        """Probability that something without a name, of some kinds, is there in the place of effects."""
        return sum(p for names, p in self.reported.items() if not names.isdisjoint(kinds))

    def over_discrepancy(self, name: str) -> float:
        """Size of an effect over that of what has no name, in the likeliest set that holds it."""
        holder = next(each for each in self.sets if name in each.names)
        return holder.sizes.effects[name] / max(holder.sizes.without_name, 1e-300)


def special_cases(name: str) -> set[str]:
    """An effect and those that it contains."""
    kind = catalogue.get(name)
    return {name, *(() if kind is None else kind.contains)}


def over_blocks(sets: Sequence[Explanation], against: Mapping[str, Array]) -> Array:
    """(S,) probabilities of sets, averaged over logs that consist of blocks of this one drawn again."""
    draw = np.random.default_rng(0)

    def again(count: int) -> Array:
        return np.asarray(draw.dirichlet(np.ones(count), size=_DRAWS) * count)

    blocks = np.array([each.weighed.by_block(BLOCKS) for each in sets])
    scores = np.array([each.log_marginal for each in sets]) + (again(BLOCKS) - 1.0) @ blocks.T
    for name, told in sorted(against.items()):
        taken = np.minimum(again(told.size) @ told, 0.0)
        scores += np.outer(taken, [name in each.names for each in sets])
    weights = np.exp(scores - scores.max(axis=1, keepdims=True))
    return np.asarray(np.mean(weights / weights.sum(axis=1, keepdims=True), axis=0))


def beside_discrepancy(explanation: Explanation, probability: float) -> dict[frozenset[str], float]:
    """The sets that one may be when parts of the discrepancy are taken out of it, with their shares of its probability.

    The smallest effect is asked first. Without it, one that looks like it is larger. Where the discrepancy is as large
    as it may be, the fit has failed: each effect may well be the nearest there is to what is missing.
    """
    found: dict[frozenset[str], float] = {}
    sound = LIKELY if explanation.discrepancy.posterior.at_its_limit else 1.0

    def ask(left: frozenset[str], kept: frozenset[str], out: frozenset[str], p: float) -> None:
        if not left or p < _NEGLIGIBLE:
            found[kept | left] = found.get(kept | left, 0.0) + p
            return
        sizes = {name: explanation.sizes.beyond(name, out) for name in sorted(left)}
        name = min(sizes, key=lambda each: sizes[each])
        whole = wide = sound * kept_share(sizes[name], explanation.sizes.to_exceed(name))
        if name in explanation.sizes.beyond_special:
            special, more = explanation.sizes.beyond_special[name]
            wide = whole * kept_share(more, INEXACT * sizes[name])
            simple = kept if special is None else kept | {special}  # excluded, it is there without a name
            ask(left - {name}, simple, out, p * (whole - wide))
        ask(left - {name}, kept | {name}, out, p * wide)
        ask(left - {name}, kept, out | {name}, p * (1.0 - whole))

    instead = explanation.names.intersection(unnamed)
    ask(explanation.names - instead, instead, frozenset(), probability)
    return found


def beside_names(explanation: Explanation, named: Explanation) -> float:
    """Share of its probability that a set with something without a name keeps beside the likeliest set of names alone.

    What it explains beyond those is counted by the likelihood, without the charges for a choice: a change d of the
    innovations is worth d^2 / (2 s^2).
    """
    laws = [size for size in named.sizes.effects.values() if np.isfinite(size)]
    if explanation.names.isdisjoint(unnamed) or not laws:
        return 1.0
    more = max(explanation.weighed.log_likelihood - named.weighed.log_likelihood, 0.0)
    return kept_share(float(np.sqrt(2.0 * more * named.discrepancy.posterior.variance)), INEXACT * max(laws))


def kept_share(size: float, beside: float) -> float:
    """Share of its probability that an effect of such a size keeps beside what it has to exceed [rad] [-]."""
    ratio = min(size / max(beside, 1e-300), _SURELY)
    return float(ratio**2 / (1.0 + ratio**2))
