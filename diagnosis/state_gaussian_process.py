"""Names weighed beside a torque without a name: any smooth function of angle, velocity and torque together.

Where a stretch of a log visits states that no other visits, whatever depends on the state there looks like many an
effect: when a sweep begins, like a payload that changes. As long as a model leaves something that such a function
explains, each of its names has to say more than the function does, and its rivals are asked beside the function too.

The function is a Gaussian process (Rasmussen and Williams 2006, sec. 8.3.1) over states of the log that lie far apart.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from diagnosis.backward_elimination import can_be_added, is_far_below
from diagnosis.hypothesis import Hypothesis
from diagnosis.model_probability import NONE, probabilities
from diagnosis.overdispersion import overdispersion
from diagnosis.refit import evidence_of, fitted_near, is_its_special_case, is_plausible, problem_near
from diagnosis.score_test import Screen
from diagnosis.stepwise_round import Addition
from diagnosis.validation import passes_validation
from identification.fit_result import Fit
from identification.log import Log
from plant.effects import CoulombFriction, Motion, Trace
from plant.effects.effect import Array

_CLEARS = np.log(1000.0)  # log of the odds from which there is such a function, and a name beside it
_PLACES = 40  # states between which it is drawn
_PASSES = 4  # over all names: what becomes of one may change what the others are worth
_ROUNDING = 1e-12  # of a state, that is no change of it
_REACH = 2.0  # standard deviations of the states over which it keeps its course


def gaussian_process_evidence(fit: Fit) -> float:
    """Log Bayes factor of a smooth function of the state, among what a fitted model leaves, against none."""
    screen = Screen.of(fit, problem_near(fit, fit.model), bandwidth=fit.bandwidth)
    ((_, evidence, _),) = screen.regress([_trace(screen.motion, fit.log)])
    return max(evidence, 0.0)


def beside_gaussian_process(
    additions: tuple[Addition, ...], base: Fit, progress: Callable[[str], None] | None = None
) -> tuple[Addition, ...]:
    """Additions to a base that still pay beside such a function, by the names that are then the best.

    Where one has gone or has another name, all are asked again, those that have gone too.
    """
    if not additions or gaussian_process_evidence(additions[-1].fit) < _CLEARS:
        return additions
    at_hand, asked, stays = additions[-1].fit, list(additions), [True for _ in additions]
    for _ in range(_PASSES):
        before = _names(asked, stays)
        for place in sorted(range(len(asked)), key=lambda place: asked[place].evidence):
            addition = asked[place]
            if progress is not None:
                progress(f"comparing {addition.effect.replace('_', ' ')} with a smooth function of the state")
            beside = at_hand if stays[place] else _with(addition, at_hand)
            again, after = _once_more(addition, beside) if beside is not None else (None, at_hand)
            at_hand = after if again is not None or stays[place] else at_hand
            asked[place], stays[place] = again or addition, again is not None
        if _names(asked, stays) == before:
            break
    left = [addition for addition, stay in zip(asked, stays, strict=True) if stay]
    if [addition.effect for addition in left] == [addition.effect for addition in additions]:
        return tuple(replace(again, fit=addition.fit) for again, addition in zip(left, additions, strict=True))
    path, at = list[Addition](), base
    for addition in left[:-1]:
        effect = at_hand.model.effect(addition.effect)
        at = fitted_near(at_hand, at.model.with_effect(effect)) if effect is not None else at
        path.append(replace(addition, fit=at))
    return (*path, *(replace(addition, fit=at_hand) for addition in left[-1:]))


def _names(asked: list[Addition], stays: list[bool]) -> list[str]:
    return [addition.effect for addition, stay in zip(asked, stays, strict=True) if stay]


def _with(addition: Addition, fit: Fit) -> Fit | None:
    """A fit with an addition that had gone, if it finds room beside the others."""
    own = next((rival.effect for rival in addition.contest if rival.effect.name == addition.effect), None)
    if own is None or not can_be_added(fit.model, own):
        return None
    again = fitted_near(fit, fit.model.with_effect(own))
    return None if again.runs_off else again


def displaced_sentences(before: tuple[Addition, ...], after: tuple[Addition, ...]) -> list[str]:
    """A sentence for each name that has no place beside such a function."""
    left = {addition.effect for addition in after}
    gone = [addition.fit.model.effect(addition.effect) for addition in before if addition.effect not in left]
    return [
        f"{effect.title.capitalize()} is rejected: a smooth function of angle, velocity and torque explains as much. "
        "To decide, record a log with the same angles and velocities in a different motion."
        for effect in gone
        if effect is not None
    ]


def _once_more(addition: Addition, fit: Fit) -> tuple[Addition | None, Fit]:
    """An addition by its best name beside the function, None if it no longer pays; and the fit that then holds.

    A function of the state leaves what depends on time alone, which is no reason to prefer it to one of the state.
    """
    own, rest = fit.model.effect(addition.effect), fit.model.without_effect(addition.effect)
    timeless = own is None or not own.clocked
    less = fitted_near(fit, rest)
    if less.runs_off:
        return addition, fit
    alone = gaussian_process_evidence(less)
    contest, fits, evidence = dict[str, Hypothesis](), dict[str, Fit](), dict[str, float]()
    for rival in addition.contest:
        name, model = rival.effect.name, rest.with_effect(rival.effect)
        strange = timeless and rival.effect.clocked
        if name != addition.effect and (strange or not can_be_added(rest, rival.effect) or is_far_below(model, fit)):
            continue
        tried = fit if name == addition.effect else fitted_near(fit, model)
        if tried.runs_off:
            continue
        contest[name], fits[name] = rival, tried
        evidence[name] = evidence_of(tried, less, over=1.0) + gaussian_process_evidence(tried) - alone
    if addition.effect not in fits:
        return addition, fit
    odds = _odds(contest, fits, evidence, less)
    if odds[NONE] > np.exp(-_CLEARS):
        return None, less
    best = next(name for name in odds if name != NONE)
    if best != addition.effect and not passes_validation(less, fits[best]):
        return addition, fit
    return replace(addition, effect=best, odds=odds, evidence=evidence_of(fits[best], less)), fits[best]


def _odds(
    contest: Mapping[str, Hypothesis], fits: Mapping[str, Fit], evidence: Mapping[str, float], less: Fit
) -> dict[str, float]:
    """Probabilities of rivals, fitted, by their evidence beside the function; what is strange is no name there.

    What each says counts as far as the log speaks for it discounted, by one measure for all: that of the rival with the
    most beyond the charge for its search.
    """
    first = max(evidence, key=lambda name: evidence[name] - contest[name].charge)
    dispersion = overdispersion(fits[first], first).factor
    counts = {name: contest[name].discounted(rise, dispersion) for name, rise in evidence.items()}
    said = {name for name, fit in fits.items() if is_plausible(fit, name) and not is_its_special_case(fit, name)}
    scores = {name: contest[name].score(fit, less, counts[name]) for name, fit in fits.items()}
    return probabilities(
        {name: score if name in said else -np.inf for name, score in scores.items()},
        {name: contest[name].visible(fit, less, counts[name]) for name, fit in fits.items()},
    )


def _trace(motion: Motion, log: Log) -> Trace:
    """One column for each of the places, as high as the state is near it; of a velocity alone the angle is no part."""
    where: tuple[Array, ...] = (motion.angle,)
    if log.axis == "rotary":
        where = (np.cos(motion.angle), np.sin(motion.angle))
    if log.response == "velocity":
        where = ()
    states = np.column_stack((*where, motion.velocity, motion.arriving(motion.torque)))
    least = np.maximum(_ROUNDING * np.abs(states).max(axis=0), 1e-300)
    states = (states - states.mean(axis=0)) / np.maximum(states.std(axis=0), least)
    places = _far_apart(states)
    prior = np.linalg.inv(_near(places, places) + 1e-4 * np.eye(len(places))).astype(np.float64)
    return Trace(columns=_near(states, places), prior=prior, start=lambda c: CoulombFriction(torque=0.0))


def _near(states: Array, places: Array) -> Array:
    """(T, P) covariance of the function at states (T, n) and places (P, n), 1 where they are the same."""
    squares = sum(np.subtract.outer(a, b) ** 2 for a, b in zip(states.T, places.T, strict=True))
    return np.asarray(np.exp(-0.5 * squares / _REACH**2))


def _far_apart(states: Array) -> Array:
    """(P, n) of the states (T, n), beginning in their middle, each as far as can be from those before."""
    distance = (states**2).sum(axis=1)
    chosen = [int(distance.argmin())]
    for _ in range(_PLACES - 1):
        newest = ((states - states[chosen[-1]]) ** 2).sum(axis=1)
        distance = np.minimum(distance, newest) if len(chosen) > 1 else newest
        chosen.append(int(distance.argmax()))
    return states[np.unique(chosen)]
