"""One round of the search: screen all effects, refit the leading ones, and weigh them against one another."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.hypothesis import Hypothesis, posterior_of
from diagnosis.model_probability import (
    CLEAR,
    NONE,
    schwarz_cost,
    search_charge,
    visibility_cost,
)
from diagnosis.multistart import multistart_refit
from diagnosis.refit import (
    estimates,
    evidence_of,
    is_its_special_case,
    is_plausible,
    problem_near,
    refit,
)
from diagnosis.result import Candidate
from diagnosis.score_test import Screen, ScreenedEffect, excess_of_neighbouring_peaks
from identification.fit_result import Fit
from identification.problem import Problem
from identification.threads import in_threads
from plant.effects import Effect

_REFITS = 5  # effects refitted in one round because they are close to the leader of the screen
_WORTH = 0.2  # share of the leader's evidence that counts as close
# By how much one may be behind that a shape which looks alike may still bring to the front: by so much evidence, or by
# such a share of the best one's. A small gap began 57 behind, large ones at 0.85 of it, what was no gap at 0.57.
_BEHIND, _BEHIND_SHARE = 100.0, 0.3
_SAME_BANDWIDTH = 0.5  # of the logarithm, within which a descent has found the best one itself
_CHANCE = 1.0  # evidence that a parameter which means nothing seldom has
_PROMISING = -5.0  # screened score below which a refit cannot clear the bar


@dataclass(frozen=True, kw_only=True, eq=False)
class Addition:
    """One effect that the search added: the fit with it, its odds, what it was worth, and whom it was chosen from."""

    effect: str
    fit: Fit
    odds: Mapping[str, float]
    evidence: float
    contest: tuple[Hypothesis, ...]

    @property
    def clear(self) -> bool:
        """Whether the name stands alone."""
        return self.odds[self.effect] >= CLEAR

    @property
    def lead(self) -> float:
        """Log of its odds over the next name's."""
        others = [share for name, share in self.odds.items() if name not in (self.effect, NONE)]
        return float(np.log(self.odds[self.effect] / max([*others, 1e-300])))


def stepwise_round(
    fit: Fit,
    effects: Mapping[str, type[Effect]],
    number: int,
    candidates: list[Candidate],
    progress: Callable[[str], None] | None,
    *,
    bar: float = CLEAR,
) -> Addition | None:
    """Ask every effect that the model does not hold; the winner if something is missing, as surely as the bar says."""
    asked = {name: kind for name, kind in effects.items() if _would_add(fit, kind)}
    if not asked:
        return None
    tell = progress or (lambda line: None)
    tell(f"round {number}: asking {len(asked)} effects")
    suspects = _screened(fit, asked)

    def charged(suspect: ScreenedEffect, peaks: float | None = None) -> float:
        return search_charge(searched=suspect.searched, catalogue=len(asked), peaks=peaks)

    charge = {s.name: charged(s) for s in suspects}
    scores = {s.name: s.evidence - schwarz_cost(s.coefficients, fit.samples) - charge[s.name] for s in suspects}
    refits: dict[str, Fit] = {}
    contest: dict[str, Hypothesis] = {}

    def ask(some: list[ScreenedEffect]) -> None:
        tell(f"round {number}: refitting with {', '.join(suspect.starts[0].title for suspect in some)}")
        found_here = in_threads(lambda each: refit(fit, *each.starts), some)
        most = max(evidence_of(found, fit) for found in (*found_here, *refits.values()))
        for suspect, found in zip(some, found_here, strict=True):
            if evidence_of(found, fit) >= most - max(_BEHIND, _BEHIND_SHARE * most):
                found = multistart_refit(fit, found, suspect.name)
            peaks = excess_of_neighbouring_peaks(found, suspect.name) if suspect.searched > 1 else None
            charge[suspect.name] = charged(suspect, peaks)
            own = Hypothesis.of(found, suspect.name, coefficients=suspect.coefficients, charge=charge[suspect.name])
            refits[suspect.name], contest[suspect.name] = found, own
            scores[suspect.name] = own.score(found, fit)

    for some in _worth_a_refit(suspects, scores, refits, observed=fit.bandwidth > 0.0):
        ask(some)
    while neighbours := _neighbours(suspects, scores, refits):
        ask(neighbours)
    for name, again in _behind_the_same_observer(fit, refits, scores):
        before = contest[name]
        own = Hypothesis.of(again, name, coefficients=before.coefficients, charge=before.charge)
        refits[name], contest[name], scores[name] = again, own, own.score(again, fit)
    for name, simpler in _reduced_leaders(fit, asked, refits, scores):
        plain = search_charge(searched=1, catalogue=len(asked))
        own = Hypothesis.of(simpler, name, coefficients=len(asked[name].parameters()), charge=plain)
        refits[name], contest[name], scores[name] = simpler, own, own.score(simpler, fit)
    odds = posterior_of(contest, refits, fit)
    visible = {s.name: s.evidence - visibility_cost(s.coefficients) - charge[s.name] for s in suspects}
    visible |= {name: own.visible(refits[name], fit) for name, own in contest.items()}
    scores |= {name: -np.inf for name, tried in refits.items() if is_its_special_case(tried, name)}
    for suspect in suspects:
        own_fit = refits.get(suspect.name)
        candidates.append(
            Candidate(
                round=number,
                effect=suspect.name,
                evidence=evidence_of(own_fit, fit) if own_fit else suspect.evidence,
                score=scores[suspect.name],
                visible=visible[suspect.name],
                probability=odds.get(suspect.name, 0.0),
                refitted=own_fit is not None,
                parameters=estimates(own_fit, suspect.name) if own_fit else {},
                plausible=own_fit is None or is_plausible(own_fit, suspect.name),
                fitted=own_fit.model.effect(suspect.name) if own_fit else None,
            )
        )
    if not refits or odds[NONE] > 1.0 - bar:
        return None
    winner = max(refits, key=lambda name: odds[name])
    return Addition(
        effect=winner,
        fit=refits[winner],
        odds=odds,
        evidence=evidence_of(refits[winner], fit),
        contest=tuple(contest.values()),
    )


def _screened(fit: Fit, asked: Mapping[str, type[Effect]]) -> list[ScreenedEffect]:
    """What the screen says at the fit's bandwidth and of the free simulation, whichever promises more.

    The starts of both are followed: what an observer leaves of an effect may be too little to tell its shape.
    """
    (screen, _), *more = Screen.views(fit)
    suspects = screen.ask(asked)
    lead = {suspect.name: suspect for suspect in suspects}
    for free, loss in more:
        for seen in free.ask(asked):
            first, second = replace(seen, evidence=seen.evidence - loss), lead[seen.name]
            if first.evidence <= second.evidence:
                first, second = second, first
            lead[seen.name] = replace(first, starts=(*first.starts, second.starts[0]))
    return sorted(lead.values(), key=lambda suspect: -suspect.score)


def _worth_a_refit(
    suspects: list[ScreenedEffect], scores: Mapping[str, float], refits: Mapping[str, Fit], *, observed: bool
) -> Iterator[list[ScreenedEffect]]:
    """Suspects to refit: the leaders of the screen, and on as long as it promises more than the refits delivered.

    Those whose turn comes whatever the others deliver come together.

    The screen understates what a long search has found, and cannot say how high the peaks beside it are. Here it is
    charged for once, in the odds twice where nobody can tell; and not at all where an observer has taken over part of
    what is missing, which a refit would give back.
    """
    once = {suspect.name: scores[suspect.name] + float(np.log(suspect.searched)) for suspect in suspects}
    waiting = sorted(suspects, key=lambda suspect: -once[suspect.name])
    leader = max((suspect.evidence for suspect in suspects), default=0.0)
    together: list[ScreenedEffect] = []
    for suspect in waiting:
        promise = once[suspect.name]
        if promise + observed * float(np.log(suspect.searched)) <= _PROMISING:
            continue
        close = suspect.evidence >= _WORTH * leader and len(refits) + len(together) < _REFITS
        if not close and together:
            yield together
            together = []
        if close or promise > max((scores[name] for name in refits), default=-np.inf):
            together.append(suspect)
    if together:
        yield together


def _neighbours(
    suspects: list[ScreenedEffect], scores: Mapping[str, float], refits: Mapping[str, Fit]
) -> list[ScreenedEffect]:
    """Suspects that the leader is known to be confused with, and that the screen had made too little of for a refit."""
    if not refits:
        return []
    leader = max(refits, key=lambda name: scores[name])
    kinds = {suspect.name: type(suspect.starts[0]) for suspect in suspects}
    return [
        suspect
        for suspect in suspects
        if suspect.name not in refits
        and suspect.evidence > _CHANCE
        and (suspect.name in kinds[leader].confused_with or leader in kinds[suspect.name].confused_with)
    ]


def _behind_the_same_observer(
    fit: Fit, refits: Mapping[str, Fit], scores: Mapping[str, float]
) -> list[tuple[str, Fit]]:
    """Rivals that are likelier behind the leader's observer than behind the one to which their own descent has come.

    Where a free simulation loses the log, as on its way over a load that could fall, a descent to slower observers may
    end early, and who got down further would win by that alone.
    """
    leader = max(refits, key=lambda name: scores[name], default=None)
    if leader is None or not (bandwidth := refits[leader].bandwidth):
        return []
    least = evidence_of(refits[leader], fit)
    least -= max(_BEHIND, _BEHIND_SHARE * least)
    better = []
    for name, found in refits.items():
        differs = not found.bandwidth or abs(np.log(found.bandwidth / bandwidth)) > _SAME_BANDWIDTH
        if name != leader and differs and evidence_of(found, fit) >= least:
            problem, starts = problem_near(fit, found.model), (refits[leader], replace(found, bandwidth=bandwidth))
            again = max(map(problem.descend, starts), key=lambda fit: fit.log_likelihood)
            if again.log_likelihood > found.log_likelihood:
                better.append((name, again))
    return better


def _reduced_leaders(
    fit: Fit, asked: Mapping[str, type[Effect]], refits: Mapping[str, Fit], scores: Mapping[str, float]
) -> list[tuple[str, Fit]]:
    """Special cases of the leading effect, fitted from its optimum, where that is better than their own refit was."""
    leader = max(refits, key=lambda name: scores[name], default=None)
    effect = refits[leader].model.effect(leader) if leader is not None else None
    if leader is None or effect is None:
        return []
    better = []
    for special in effect.reduced():
        if special.name in asked:
            model = fit.model.with_effect(special)
            again = Problem.of(fit.log, model, known=fit.known).descend(refits[leader])
            if special.name not in refits or again.log_likelihood > refits[special.name].log_likelihood:
                better.append((special.name, again))
    return better


def _would_add(fit: Fit, kind: type[Effect]) -> bool:
    """Whether an effect can be seen in this log and is neither in the model nor a special case of one that is."""
    return not fit.model.holds(kind.name) and fit.log.shows(kind)
