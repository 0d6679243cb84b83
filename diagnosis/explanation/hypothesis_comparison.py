"""The contest: how far a name was ahead of its rivals in the round of the search that it won."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from diagnosis.model_probability import NONE, SEEN
from diagnosis.result import Candidate, Cause, Findings

AGAIN = 0
"""In place of a round: a cause that was weighed again at the end, beside the others."""
NOTICED = float(np.log(SEEN / (1.0 - SEEN)))
"""Log odds of "something is missing" from which it is told."""


@dataclass(frozen=True, kw_only=True)
class HypothesisComparison:
    """One round of the search. The effect "none" stands for the model as it was, from which evidence is counted.

    Attributes:
        round: its number, from 1; `AGAIN` where a cause was weighed once more, with scores up to a constant.
        leader: the explanation that the round is told for.
        rivals: the other ones that were fitted, "none" among them, the likeliest first.
        alike: fitted too, but they said no more than a special case of theirs that was fitted beside them.
        strange: fitted too, but with values that their causes hardly ever have.
        screened: what the linearised screen had put aside, the most promising first.
        fitted: number of effects that were fitted.
    """

    round: int
    leader: Candidate
    rivals: tuple[Candidate, ...]
    alike: tuple[str, ...]
    strange: tuple[str, ...]
    screened: tuple[Candidate, ...]
    fitted: int

    @classmethod
    def of_round(cls, tried: tuple[Candidate, ...], number: int) -> HypothesisComparison:
        """A round as it was held, its likeliest explanation in the lead."""
        held = sorted((c for c in tried if c.round == number), key=lambda c: -c.score)
        fitted = [c for c in held if c.refitted and np.isfinite(c.score)]
        something = _together([c.visible for c in fitted])
        none = Candidate(
            round=number,
            effect=NONE,
            evidence=0.0,
            # So that odds between names and none are those of both questions together.
            score=_together([c.score for c in fitted]) - something if fitted else 0.0,
            visible=0.0,
            probability=float(np.exp(-np.logaddexp(0.0, something))),
            refitted=True,
            parameters={},
        )
        leader, *rivals = sorted((*fitted, none), key=lambda c: -c.score)
        return cls(
            round=number,
            leader=leader,
            rivals=tuple(rivals),
            alike=tuple(c.effect for c in held if c.refitted and not np.isfinite(c.score)),
            strange=tuple(c.effect for c in held if not c.plausible),
            screened=tuple(c for c in held if not c.refitted),
            fitted=sum(c.refitted for c in held),
        )

    @property
    def runner_up(self) -> Candidate | None:
        """The likeliest rival, if there was one."""
        return self.rivals[0] if self.rivals else None

    @property
    def effects(self) -> tuple[Candidate, ...]:
        """What was fitted, without "none"."""
        return tuple(c for c in (self.leader, *self.rivals) if c.effect != NONE)

    @property
    def asked(self) -> int:
        """Number of effects that were asked."""
        return self.fitted + len(self.screened)

    @property
    def best(self) -> Candidate | None:
        """The effect with the best score, fitted or, where none was, screened."""
        return next(iter((*self.effects, *self.screened)), None)

    @property
    def something(self) -> float:
        """Log odds that one of the fitted effects is there, against none of them."""
        return _together([c.visible for c in self.effects])


def _together(scores: list[float]) -> float:
    """Score of any of several explanations."""
    return float(np.logaddexp.reduce(scores)) if scores else -np.inf


def comparison_of(diagnosis: Findings, cause: Cause) -> HypothesisComparison:
    """The round that a cause won; what else has been named is no rival of it.

    The search may have put a special case in the place of the winner later on, and the evidence tells the round all the
    same. Or it has weighed the cause again beside the others, and then there is no round of that evidence, but odds.
    """
    named = {other.effect for other in diagnosis.causes}
    for number in sorted({c.round for c in diagnosis.candidates}):
        contest = HypothesisComparison.of_round(diagnosis.candidates, number)
        if contest.leader.effect != NONE and np.isclose(contest.leader.evidence, cause.evidence, rtol=1e-9):
            return replace(contest, rivals=tuple(c for c in contest.rivals if c.effect not in named))
    leader, *rivals = (_weighed(name, p) for name, p in ((cause.effect, cause.probability), *cause.alternatives))
    return HypothesisComparison(
        round=AGAIN,
        leader=replace(leader, evidence=cause.evidence),
        rivals=tuple(rivals),
        alike=(),
        strange=(),
        screened=(),
        fitted=0,
    )


def _weighed(effect: str, probability: float) -> Candidate:
    """An explanation of which only the odds are known."""
    return Candidate(
        round=AGAIN,
        effect=effect,
        evidence=np.nan,
        score=float(np.log(max(probability, 1e-300))),
        visible=np.nan,
        probability=probability,
        refitted=True,
        parameters={},
    )
