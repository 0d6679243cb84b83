"""The search: screen, refit the leading effects, add the winner, repeat; then take out what became superfluous."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.holdout import simulation_gain, standard_errors
from diagnosis.odds import CLEAR, MISSING, NONE, parameter_cost, probabilities, schwarz_cost, score, typical_speed
from diagnosis.result import Candidate, Estimate
from diagnosis.screen import Screen, Suspect
from identification.fit_result import Fit
from identification.problem import Problem
from plant.effects import Effect, catalogue
from plant.effects.effect import Array
from plant.servo import ServoModel

_REFITS = 5  # effects refitted in one round because they are close to the leader of the screen
_WORTH = 0.2  # share of the leader's evidence that counts as close
_PROMISING = -5.0  # screened score below which a refit cannot clear the bar
_ROUNDS = 6
_DESCENTS = 2  # starts of one effect that are followed to the end
_SIGNIFICANT = 2.0  # standard errors
_UNSEEN = 0.25  # share at the end of each run on which a winner must hold up without having been fitted to it


@dataclass(frozen=True, kw_only=True, eq=False)
class Addition:
    """One effect that the search added: the fit with it, its odds in that round and what it was worth."""

    effect: str
    fit: Fit
    odds: Mapping[str, float]
    evidence: float

    @property
    def clear(self) -> bool:
        """Whether the name stands alone."""
        return self.odds[self.effect] >= CLEAR


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What the search found: additions in order, the final fit and everything that was tried."""

    base: Fit
    additions: tuple[Addition, ...]
    candidates: tuple[Candidate, ...]

    @property
    def fit(self) -> Fit:
        """The fit of the extended model."""
        return self.additions[-1].fit if self.additions else self.base


def search(
    base: Fit, effects: Mapping[str, type[Effect]] = catalogue, *, progress: Callable[[str], None] | None = None
) -> Outcome:
    """Extend a fitted model by those of the effects that its log asks for."""
    additions: list[Addition] = []
    candidates: list[Candidate] = []
    fit = base
    for number in range(1, _ROUNDS + 1):
        found = _one_round(fit, effects, number, candidates, progress)
        if found is None:
            break
        better = _better_null(fit, found)
        if better is not None:
            # The model at hand had only stopped at a poor optimum: what seemed missing is judged again from there.
            base, fit = (better, better) if not additions else (base, better)
            if additions:
                additions[-1] = replace(additions[-1], fit=fit)
            continue
        additions.append(found)
        fit = found.fit
        additions = _without_superfluous(base, additions, progress)
        fit = additions[-1].fit if additions else base
    return Outcome(base=base, additions=tuple(additions), candidates=tuple(candidates))


def _one_round(
    fit: Fit,
    effects: Mapping[str, type[Effect]],
    number: int,
    candidates: list[Candidate],
    progress: Callable[[str], None] | None,
) -> Addition | None:
    """Ask every effect that the model does not hold; the winner if something is missing and it holds up unseen."""
    asked = {name: kind for name, kind in effects.items() if _would_add(fit, kind)}
    if not asked:
        return None
    suspects = _screened(fit, asked)

    def scored(suspect: Suspect, evidence: float, cost: float) -> float:
        return score(evidence, cost=cost, searched=suspect.searched, catalogue=len(asked))

    scores = {s.name: scored(s, s.evidence, schwarz_cost(s.columns, fit.samples)) for s in suspects}
    refits: dict[str, Fit] = {}
    for suspect in _worth_a_refit(suspects, scores, refits):
        if progress is not None:
            progress(f"round {number}: refitting with {suspect.starts[0].title}")
        tried = refits[suspect.name] = refit(fit, *suspect.starts)
        scores[suspect.name] = scored(suspect, evidence_of(tried, fit), parameter_cost(tried, fit))
    for name, simpler in _reduced_leaders(fit, asked, refits, scores):
        refits[name] = simpler
        cost = parameter_cost(simpler, fit)
        scores[name] = score(evidence_of(simpler, fit), cost=cost, searched=1, catalogue=len(asked))
    for name, tried in refits.items():
        if _has_simpler_form(tried, name):
            scores[name] = -np.inf
    odds = probabilities({name: value for name, value in scores.items() if name in refits or not refits})
    for suspect in suspects:
        own = refits.get(suspect.name)
        candidates.append(
            Candidate(
                round=number,
                effect=suspect.name,
                evidence=evidence_of(own, fit) if own else suspect.evidence,
                score=scores[suspect.name],
                probability=odds.get(suspect.name, 0.0),
                refitted=own is not None,
                parameters=estimates(own, suspect.name) if own else {},
            )
        )
    if not refits or odds[NONE] > 1.0 - MISSING:
        return None
    winner = max(refits, key=lambda name: odds[name])
    if not holds_up(fit, refits[winner]):
        return None
    return Addition(effect=winner, fit=refits[winner], odds=odds, evidence=evidence_of(refits[winner], fit))


def _better_null(fit: Fit, found: Addition) -> Fit | None:
    """The model without the addition, fitted from the addition's optimum, if it is clearly likelier than it was."""
    problem = Problem.of(fit.log, fit.model, fixed=fit.fixed)
    again = problem.descend(found.fit)
    return again if evidence_of(again, fit) > 3.0 else None


def _screened(fit: Fit, asked: Mapping[str, type[Effect]]) -> list[Suspect]:
    """What the screen says at the fit's bandwidth and of the free simulation, whichever promises more."""
    (screen, _), *more = Screen.views(fit)
    suspects = screen.ask(asked)
    lead = {suspect.name: suspect for suspect in suspects}
    for free, loss in more:
        for suspect in free.ask(asked):
            if suspect.evidence - loss > lead[suspect.name].evidence:
                lead[suspect.name] = replace(suspect, evidence=suspect.evidence - loss)
    return sorted(lead.values(), key=lambda suspect: -suspect.score)


def _worth_a_refit(
    suspects: list[Suspect], scores: Mapping[str, float], refits: Mapping[str, Fit]
) -> Iterator[Suspect]:
    """Suspects to refit: the leaders of the screen, and on as long as it promises more than the refits delivered."""
    waiting = sorted(suspects, key=lambda suspect: -scores[suspect.name])
    leader = max((suspect.evidence for suspect in suspects), default=0.0)
    for suspect in waiting:
        promise = scores[suspect.name]
        delivered = max((scores[name] for name in refits), default=-np.inf)
        close = suspect.evidence >= _WORTH * leader and len(refits) < _REFITS
        # The screen understates what a long search has found: here it is charged for once, in the odds twice.
        if promise + float(np.log(suspect.searched)) > _PROMISING and (close or promise > delivered):
            yield suspect


def _has_simpler_form(fit: Fit, name: str) -> bool:
    """Whether a refitted effect says no more than a special case of it: parameters stay open, or its shape vanishes."""
    effect = fit.model.effect(name)
    if effect is None or not effect.reduced():
        return False
    unsaid = any(estimate.std is None for estimate in estimates(fit, name).values())
    return unsaid or effect.vanishes(typical_speed(fit))


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
            again = Problem.of(fit.log, model, fixed=fit.fixed).descend(refits[leader])
            if special.name not in refits or again.log_likelihood > refits[special.name].log_likelihood:
                better.append((special.name, again))
    return better


def _would_add(fit: Fit, kind: type[Effect]) -> bool:
    """Whether an effect makes sense on this axis and is neither in the model nor a special case of one that is."""
    held = {name for effect in fit.model.effects for name in (effect.name, *effect.contains)}
    return kind.name not in held and fit.model.axis in kind.axes


def evidence_of(fit: Fit, than: Fit) -> float:
    """By how much a fit is likelier than a simpler one, each less its charge for a bandwidth.

    Where innovations have a colour, a likelihood ratio counts too much. It is divided by the factor by which the colour
    widens the variance of the parameters that the fit has more (the scaled likelihood ratio of Satorra and Bentler).
    """
    charge = 0.5 * float(np.log(fit.samples))
    rise = fit.log_likelihood - than.log_likelihood - charge * ((fit.bandwidth > 0.0) - (than.bandwidth > 0.0))
    more = [row for row, place in enumerate(fit.free) if fit.model.names[place] not in than.model.names]
    if not more or rise <= 0.0:
        return rise
    coloured, white = (np.diag(table)[more] for table in (fit.covariance, fit.white_covariance))
    known = white > 0.0
    widening = float(np.exp(np.mean(np.log(coloured[known] / white[known])))) if known.any() else 1.0
    return rise / max(widening, 1.0)


def refit(fit: Fit, *starts: Effect, fixed: tuple[str, ...] = ()) -> Fit:
    """Fit the model with one effect more, from where the screen says it is: from the starts that get on best."""
    models = [fit.model.with_effect(start) for start in starts]
    kept = [name for name in (*fit.fixed, *fixed) if name in models[0].names]
    problems = [Problem.of(fit.log, model, fixed=kept) for model in models]
    if len(problems) > _DESCENTS:
        problems = sorted(problems, key=lambda problem: problem.glance(fit))[:_DESCENTS]
    return max((problem.descend(fit) for problem in problems), key=lambda found: found.log_likelihood)


def estimates(fit: Fit, effect: str) -> dict[str, Estimate]:
    """The estimates of one effect's parameters."""
    own = fit.model.effect(effect)
    if own is None:
        return {}
    lines = {spec.name: fit[f"{effect}.{spec.name}"] for spec in own.parameters()}
    return {
        name: Estimate(value=float(getattr(own, name)), std=line.std, unit=line.unit) for name, line in lines.items()
    }


def holds_up(before: Fit, after: Fit) -> bool:
    """Whether an extended model stands beside its predecessor on what neither was chosen by.

    The odds have decided on one-step predictions of the whole record. The free simulation must not get significantly
    worse; and predictions of the last part of each run, after a fit to the first part, neither, unless the simulation
    gets significantly better.
    """
    simulation = simulation_gain(before, after)
    if simulation < -_SIGNIFICANT:
        return False
    bandwidth = max(before.bandwidth, after.bandwidth)
    unseen = standard_errors(_unseen(after, bandwidth) - _unseen(before, bandwidth))
    return unseen > -_SIGNIFICANT or simulation > _SIGNIFICANT


def _unseen(fit: Fit, bandwidth: float) -> Array:
    """(U,) log-likelihood of each sample in the last part of the runs, after a fit to the first part."""
    seen = replace(fit.log, runs=tuple(run.slice(0, int(len(run) * (1.0 - _UNSEEN))) for run in fit.log.runs))
    problem = Problem.of(seen, fit.model, fixed=fit.fixed)
    best = problem.minimise(problem.pack(fit.model.values, fit.initial), bandwidth, 0.0, iterations=5)
    values, initial = problem.unpack(best.point)
    variance = best.equations.cost / problem.samples
    whole = replace(problem.predictor, runs=fit.log.runs, free=())
    predictions = whole.predict(values, initial, bandwidth=bandwidth, width=0.0, sensitivities=False)
    pairs = zip(seen.runs, predictions, strict=True)
    unseen = np.concatenate([prediction.innovations[len(part) :] for part, prediction in pairs])
    return np.asarray(-0.5 * unseen**2 / variance - 0.5 * np.log(variance))


def _without_superfluous(
    base: Fit, additions: list[Addition], progress: Callable[[str], None] | None
) -> list[Addition]:
    """Take out of each earlier addition what no longer pays beside the last: all of it, or down to a special case."""
    for addition in additions[:-1]:
        fit = additions[-1].fit
        effect = fit.model.effect(addition.effect)
        if effect is None:  # the last addition contains it
            additions = [a for a in additions if a is not addition]
            continue
        if progress is not None:
            progress(f"is {effect.title} still needed?")
        simpler = _simplest_that_does(fit, effect)
        if simpler is None:
            continue
        place, special, leaner = additions.index(addition), *simpler
        additions = [*additions[:-1], replace(additions[-1], fit=leaner)]
        if special is None:
            del additions[place]
        else:
            additions[place] = replace(additions[place], effect=special.name, odds=_handed_over(addition, special))
    return additions


def _simplest_that_does(fit: Fit, effect: Effect) -> tuple[Effect | None, Fit] | None:
    """The model without an effect, or with a special case of it instead, if that costs less evidence than it saves."""
    without = fit.model.without_effect(effect.name)
    variants: list[tuple[Effect | None, ServoModel]] = [(None, without)]
    variants += [(special, without.with_effect(special)) for special in effect.reduced()]
    for special, model in variants:
        fixed = [name for name in fit.fixed if name in model.names]
        leaner = Problem.of(fit.log, model, fixed=fixed).descend(fit)
        says_no_less = special is not None and _has_simpler_form(fit, effect.name)
        if says_no_less or evidence_of(fit, leaner) < parameter_cost(fit, leaner):
            return special, leaner
    return None


def _handed_over(addition: Addition, special: Effect) -> dict[str, float]:
    """The odds of an addition after a special case of it has taken its place."""
    odds = {name: share for name, share in addition.odds.items() if name != addition.effect}
    odds[special.name] = odds.get(special.name, 0.0) + addition.odds[addition.effect]
    return dict(sorted(odds.items(), key=lambda item: -item[1]))
