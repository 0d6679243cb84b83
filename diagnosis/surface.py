"""Names weighed beside a torque without a name: any smooth function of angle, velocity and torque together.

Where a stretch of a log visits states that no other visits, whatever depends on the state there looks like many an
effect: when a sweep begins, like a payload that changes. As long as a model leaves something that such a function
explains, each of its names has to say more than the function does, and its rivals are asked beside the function too.

The function is a Gaussian process (Rasmussen and Williams 2006, sec. 8.3.1) over states of the log that lie far apart.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from diagnosis.backward import falls_short, fits_in
from diagnosis.odds import MISSING, NONE, probabilities
from diagnosis.refit import evidence_of, fitted_near, is_its_special_case, is_plausible, problem_near
from diagnosis.round import Addition
from diagnosis.screen import Screen
from diagnosis.unseen import holds_up
from identification.fit_result import Fit
from plant.effects import CoulombFriction, Motion, Trace
from plant.effects.effect import Array

_CLEARS = np.log(1000.0)  # log Bayes factor from which something is left for the function
_PLACES = 40  # states between which it is drawn
_REACH = 2.0  # standard deviations of the states over which it keeps its course


def surface_evidence(fit: Fit) -> float:
    """Log Bayes factor of a smooth function of the state, among what a fitted model leaves, against none."""
    screen = Screen.of(fit, problem_near(fit, fit.model), bandwidth=fit.bandwidth)
    ((_, evidence, _),) = screen.regress([_trace(screen.motion, fit.model.axis)])
    return max(evidence, 0.0)


def beside_surface(
    additions: tuple[Addition, ...], base: Fit, progress: Callable[[str], None] | None = None
) -> tuple[Addition, ...]:
    """Additions to a base that still pay beside such a function, by the names that are then the best."""
    if not additions or surface_evidence(additions[-1].fit) < _CLEARS:
        return additions
    at_hand, kept = additions[-1].fit, dict[str, Addition]()
    for addition in sorted(additions, key=lambda addition: addition.evidence):
        if progress is not None:
            progress(f"or is it not {addition.effect.replace('_', ' ')} but any smooth function of the state?")
        again, at_hand = _once_more(addition, at_hand)
        if again is not None:
            kept[addition.effect] = again
    left = [kept[addition.effect] for addition in additions if addition.effect in kept]
    if [addition.effect for addition in left] == [addition.effect for addition in additions]:
        return tuple(replace(again, fit=addition.fit) for again, addition in zip(left, additions, strict=True))
    path, at = list[Addition](), base
    for addition in left[:-1]:
        effect = at_hand.model.effect(addition.effect)
        at = fitted_near(at_hand, at.model.with_effect(effect)) if effect is not None else at
        path.append(replace(addition, fit=at))
    return (*path, *(replace(addition, fit=at_hand) for addition in left[-1:]))


def gave_way(before: tuple[Addition, ...], after: tuple[Addition, ...]) -> list[str]:
    """A sentence for each name that has no place beside such a function."""
    left = {addition.effect for addition in after}
    gone = [addition.fit.model.effect(addition.effect) for addition in before if addition.effect not in left]
    return [
        f"{effect.title.capitalize()} would fit too, but not once anything that depends on angle, velocity and torque "
        "together is allowed for; a log that comes by the same states in other ways would tell."
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
    alone = surface_evidence(less)
    fits, scores, visible = {}, {}, {}
    for rival in addition.contest:
        name, model = rival.effect.name, rest.with_effect(rival.effect)
        strange = timeless and rival.effect.clocked
        if name != addition.effect and (strange or not fits_in(rest, rival.effect) or falls_short(model, fit)):
            continue
        tried = fit if name == addition.effect else fitted_near(fit, model)
        if tried.runs_off:
            continue
        more = surface_evidence(tried) - alone
        fits[name] = tried
        said = is_plausible(tried, name) and not is_its_special_case(tried, name)
        scores[name] = rival.score(tried, less, over=1.0) + more if said else -np.inf
        visible[name] = rival.visible(tried, less, over=1.0) + more
    if addition.effect not in fits:
        return addition, fit
    odds = probabilities(scores, visible)
    if odds[NONE] > 1.0 - MISSING:
        return None, less
    best = next(name for name in odds if name != NONE)
    if best != addition.effect and not holds_up(less, fits[best]):
        return addition, fit
    return replace(addition, effect=best, odds=odds, evidence=evidence_of(fits[best], less)), fits[best]


def _trace(motion: Motion, axis: str) -> Trace:
    """One column for each of the places, as high as the state is near it."""
    where = (np.cos(motion.angle), np.sin(motion.angle)) if axis == "rotary" else (motion.angle,)
    states = np.column_stack((*where, motion.velocity, motion.arriving(motion.torque)))
    states = (states - states.mean(axis=0)) / np.maximum(states.std(axis=0), 1e-12)
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
