"""The joint posterior over sets of effects, and what may be said of each name."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from diagnosis.evidence.marginal import Explanation


@dataclass(frozen=True, kw_only=True, eq=False)
class Posterior:
    """Over sets.

    Attributes:
        sets: the likeliest first.
        probabilities: of each.
    """

    sets: tuple[Explanation, ...]
    probabilities: tuple[float, ...]

    @classmethod
    def over(cls, explanations: Iterable[Explanation]) -> Posterior:
        """Of all that were weighed."""
        ordered = sorted(explanations, key=lambda each: -each.log_marginal)
        scores = np.array([each.log_marginal for each in ordered])
        weights = np.exp(scores - scores[0])
        return cls(sets=tuple(ordered), probabilities=tuple((weights / weights.sum()).tolist()))

    @property
    def best(self) -> Explanation:
        """The likeliest set."""
        return self.sets[0]

    def of(self, name: str) -> float:
        """Probability that an effect is there: of all sets that hold it together."""
        return sum(p for each, p in zip(self.sets, self.probabilities, strict=True) if name in each.names)

    def names(self) -> dict[str, float]:
        """Each name with its probability, the likeliest first."""
        every = {name for each in self.sets for name in each.names}
        return dict(sorted(((name, self.of(name)) for name in every), key=lambda item: -item[1]))

    def over_discrepancy(self, name: str) -> float:
        """Size of an effect over that of the discrepancy, in the likeliest set that holds it."""
        holder = next(each for each in self.sets if name in each.names)
        return holder.sizes[name] / max(holder.discrepancy.posterior.size, 1e-300)

    def told(self, name: str) -> float:
        """Probability that an effect is there, times the share that it has of what it and the discrepancy explain.

        What is significant, but smaller than what no name explains, may well be a part of that.
        """
        ratio = min(self.over_discrepancy(name), 1e6)
        return self.of(name) * ratio**2 / (1.0 + ratio**2)
