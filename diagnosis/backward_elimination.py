"""Backward: what earlier additions are still needed for, and whether each is still the best in its place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from diagnosis.hypothesis import posterior_of
from diagnosis.model_probability import CLEAR, NONE, parameter_cost, schwarz_cost
from diagnosis.multistart import multistart_refit
from diagnosis.refit import evidence_of, fitted_near, is_its_special_case, problem_near
from diagnosis.stepwise_round import Addition
from diagnosis.validation import passes_validation
from identification.fit_result import Fit
from identification.noise import log_likelihood
from plant.effects import Effect
from plant.servo import ServoModel

_SHORT = 30.0  # times what a leaner model saves, which it loses at a first look


def backward_elimination(
    base: Fit,
    additions: list[Addition],
    effects: Mapping[str, type[Effect]],
    progress: Callable[[str], None] | None,
) -> list[Addition]:
    """Take out of each earlier addition what no longer pays beside the last: all of it, or down to a special case.

    Only to one that is among the effects that are asked.
    """
    for addition in additions[:-1]:
        fit = additions[-1].fit
        effect = fit.model.effect(addition.effect)
        if effect is None:  # the last addition contains it
            additions = [a for a in additions if a is not addition]
            continue
        if progress is not None:
            progress(f"is {effect.title} still needed?")
        simpler = _simplest_that_does(fit, effect, effects)
        if simpler is None:
            continue
        place, special, leaner = additions.index(addition), *simpler
        additions = [*additions[:-1], replace(additions[-1], fit=leaner)]
        if special is None:
            del additions[place]
        else:
            additions[place] = replace(additions[place], effect=special.name, odds=_handed_over(addition, special))
    return additions


def _simplest_that_does(
    fit: Fit, effect: Effect, effects: Mapping[str, type[Effect]]
) -> tuple[Effect | None, Fit] | None:
    """The model without an effect, or with a special case of it instead, if that costs less evidence than it saves."""
    without = fit.model.without_effect(effect.name)
    variants: list[tuple[Effect | None, ServoModel]] = [(None, without)]
    others = [special for special in effect.reduced() if special.name in effects and not without.holds(special.name)]
    variants += [(special, without.with_effect(special)) for special in others]
    for special, model in variants:
        if is_far_below(model, fit):
            continue
        leaner = fitted_near(fit, model)
        says_no_less = special is not None and is_its_special_case(fit, effect.name)
        if says_no_less or evidence_of(fit, leaner) < parameter_cost(fit, leaner):
            return special, leaner
    return None


def is_far_below(model: ServoModel, fit: Fit) -> bool:
    """Whether a model in place of a fit loses so much after a few iterations that no descent makes it good.

    It is also looked at behind a slow observer, which may take over what it lacks. Of a chaotic model no first look
    tells.
    """
    if model.chaotic:
        return False
    problem = problem_near(fit, model)
    slow = 4.0 / max(run.duration for run in fit.log.runs)
    cost = min(problem.glance(fit, bandwidth) for bandwidth in {fit.bandwidth, max(fit.bandwidth, slow)})
    saved = max(len(fit.free) - len(problem.free), 1)
    return fit.log_likelihood - log_likelihood(cost, fit.samples) > _SHORT * schwarz_cost(saved, fit.samples)


def _handed_over(addition: Addition, special: Effect) -> dict[str, float]:
    """The odds of an addition after a special case of it has taken its place."""
    odds = {name: share for name, share in addition.odds.items() if name != addition.effect}
    odds[special.name] = odds.get(special.name, 0.0) + addition.odds[addition.effect]
    return dict(sorted(odds.items(), key=lambda item: -item[1]))


def with_likeliest_effects(additions: list[Addition], progress: Callable[[str], None] | None) -> list[Addition]:
    """Weigh each addition once more against those that it was chosen from, beside all the others.

    The first of several effects was found while the others were still missing: its rivals may fit better now, another
    shape of it too, and beside a better name another may have nothing left to explain.
    """
    for name in [addition.effect for addition in additions]:
        if len(additions) < 2:
            break
        place = next(place for place, addition in enumerate(additions) if addition.effect == name)
        addition, final = additions[place], additions[-1].fit
        rest = final.model.without_effect(addition.effect)
        if progress is not None:
            progress(f"is it still {addition.effect.replace('_', ' ')}?")
        rivals = {
            rival.effect.name: rival
            for rival in addition.contest
            if rival.effect.name == addition.effect
            or (can_be_added(rest, rival.effect) and not is_far_below(rest.with_effect(rival.effect), final))
        }
        if name not in rivals:
            continue
        less = fitted_near(final, rest)
        fits = {
            rival: final if rival == name else fitted_near(final, rest.with_effect(contestant.effect))
            for rival, contestant in rivals.items()
        }
        fits = {rival: multistart_refit(less, found, rival) for rival, found in fits.items()}
        odds = posterior_of(rivals, fits, less)
        if better := _better_special_cases(fits[_leader(odds)], _leader(odds), rest, fits):
            odds = posterior_of(rivals, fits := fits | better, less)
        if odds[NONE] > 1.0 - CLEAR:
            additions = [*additions[:place], *additions[place + 1 :]]
            additions[-1] = replace(additions[-1], fit=less)
            continue
        best = _leader(odds)
        if best != addition.effect and not passes_validation(less, fits[best]):
            continue
        changed = replace(addition, effect=best, odds=odds, evidence=evidence_of(fits[best], less))
        additions = [*additions[:place], changed, *additions[place + 1 :]]
        additions[-1] = replace(additions[-1], fit=fits[best])
    return additions


def _leader(odds: Mapping[str, float]) -> str:
    return next(name for name in odds if name != NONE)


def _better_special_cases(leading: Fit, name: str, rest: ServoModel, fits: Mapping[str, Fit]) -> dict[str, Fit]:
    """Rivals that are special cases of the leader and fit better from its optimum than from where they came."""
    effect = leading.model.effect(name)
    specials = effect.reduced() if effect is not None else ()
    again = {s.name: fitted_near(leading, rest.with_effect(s)) for s in specials if s.name in fits}
    return {name: found for name, found in again.items() if found.log_likelihood > fits[name].log_likelihood}


def can_be_added(model: ServoModel, effect: Effect) -> bool:
    """Whether an effect can be added without anything else having to go, and says what nothing in the model does."""
    return not model.holds(effect.name) and len(model.with_effect(effect).effects) == len(model.effects) + 1
