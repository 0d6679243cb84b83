"""The joint posterior over sets of effects, and what may be said of each name.

What is significant, but smaller than what no name explains, may well be a part of that. So a name keeps

    r^2 / (1 + r^2)

of its probability, with r what it changes in the innovations over what the discrepancy explains there; the rest goes to
the same set without it. An effect that has a simpler one as its special case is asked twice: what it adds to that may
be a part of the discrepancy, and so may all of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from diagnosis.evidence.marginal import Explanation

_NEGLIGIBLE = 1e-4  # probability of a set whose effects are not weighed against the discrepancy
_EXACT = 0.01  # of an effect: no law is exact to less, so a wider form has to add more to be told
_SURELY = 1e6  # ratio that is as good as any larger one


@dataclass(frozen=True, kw_only=True, eq=False)
class Posterior:
    """Over sets.

    Attributes:
        sets: as they were fitted, the likeliest first.
        probabilities: of each, by its evidence alone.
        believed: sets of names, the likeliest first, with what remains for each beside the discrepancy.
    """

    sets: tuple[Explanation, ...]
    probabilities: tuple[float, ...]
    believed: Mapping[frozenset[str], float]

    @classmethod
    def over(cls, explanations: Iterable[Explanation]) -> Posterior:
        """Of all that were weighed."""
        ordered = sorted(explanations, key=lambda each: -each.log_marginal)
        scores = np.array([each.log_marginal for each in ordered])
        weights = np.exp(scores - scores[0])
        probabilities = tuple((weights / weights.sum()).tolist())
        believed: dict[frozenset[str], float] = {}
        for each, p in zip(ordered, probabilities, strict=True):
            for names, share in (beside_discrepancy(each) if p > _NEGLIGIBLE else {each.names: 1.0}).items():
                believed[names] = believed.get(names, 0.0) + p * share
        ranked = dict(sorted(believed.items(), key=lambda item: -item[1]))
        return cls(sets=tuple(ordered), probabilities=probabilities, believed=ranked)

    @property
    def best(self) -> Explanation:
        """The likeliest set that is believed and was fitted."""
        fitted = {each.names: each for each in reversed(self.sets)}
        return next(fitted[names] for names in self.believed if names in fitted)

    def of(self, name: str) -> float:
        """Probability that an effect is there by the evidence alone: of all sets that hold it together."""
        return sum(p for each, p in zip(self.sets, self.probabilities, strict=True) if name in each.names)

    def told(self, name: str) -> float:
        """Probability that an effect is there, and no part of what no name explains."""
        return sum(p for names, p in self.believed.items() if name in names)

    def names(self) -> dict[str, float]:
        """Each name with its probability by the evidence alone, the likeliest first."""
        every = {name for names in self.believed for name in names}
        return dict(sorted(((name, self.of(name)) for name in every), key=lambda item: -item[1]))

    def over_discrepancy(self, name: str) -> float:
        """Size of an effect over that of the discrepancy, in the likeliest set that holds it."""
        holder = next(each for each in self.sets if name in each.names)
        return holder.sizes.effects[name] / max(holder.sizes.discrepancy, 1e-300)


def beside_discrepancy(explanation: Explanation) -> dict[frozenset[str], float]:
    """The sets that one may be when parts of the discrepancy are taken out of it, with their shares."""
    found: dict[frozenset[str], float] = {frozenset(): 1.0}
    for name in sorted(explanation.names):
        whole = kept_share(explanation, explanation.sizes.effects[name])
        ways = [(frozenset({name}), whole), (frozenset[str](), 1.0 - whole)]
        if name in explanation.sizes.beyond_special:
            special, more = explanation.sizes.beyond_special[name]
            wide = whole * kept_share(explanation, more, least=_EXACT * explanation.sizes.effects[name])
            ways = [(frozenset({name}), wide), (frozenset({special}), whole - wide), ways[-1]]
        found = _with(found, ways)
    return found


def _with(
    found: Mapping[frozenset[str], float], ways: Iterable[tuple[frozenset[str], float]]
) -> dict[frozenset[str], float]:
    both: dict[frozenset[str], float] = {}
    for own, share in ways:
        for names, p in found.items():
            if share > 0.0:
                both[names | own] = both.get(names | own, 0.0) + p * share
    return both


def kept_share(explanation: Explanation, size: float, least: float = 0.0) -> float:
    """Share of its probability that an effect of such a size [rad] keeps beside the discrepancy, or `least` [-]."""
    ratio = min(size / max(explanation.sizes.discrepancy, least, 1e-300), _SURELY)
    return float(ratio**2 / (1.0 + ratio**2))
