"""Fits of a model with one effect more, and what they are worth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diagnosis.model_probability import typical_speed
from diagnosis.motion import turn_of
from diagnosis.result import Estimate
from identification.fit_result import Fit
from identification.problem import Problem
from identification.threads import in_threads
from plant.effects import Effect
from plant.servo import ServoModel

_DESCENTS = 2  # starts of one effect that are followed to the end
_FAST = 0.1  # bandwidth of an observer over the sampling rate, from which it follows anything
_NOTHING = 1e-3  # rise of the log-likelihood that says nothing


def refit(fit: Fit, *starts: Effect, fixed: tuple[str, ...] = ()) -> Fit:
    """Fit the model with one effect more, from where the screen says it is: from the starts that get on best.

    Where they end no better than without the effect, they have stopped on the way, and it begins anew from elsewhere;
    unless behind an observer that follows anything, where what hardly shows is nothing.
    """
    found = _from_the_best(fit, starts, fixed)
    nothing = found.log_likelihood < fit.log_likelihood + _NOTHING and not follows_anything(fit)
    others = starts[0].elsewhere(fit.noise_std) if nothing else ()
    return max((found, *([_from_the_best(fit, others, fixed)] if others else [])), key=lambda fit: fit.log_likelihood)


def _from_the_best(fit: Fit, starts: Sequence[Effect], fixed: tuple[str, ...]) -> Fit:
    def problem(start: Effect) -> Problem:
        return problem_near(fit, fit.model.with_effect(start), fixed)

    problems = [problem(start) for start in starts]
    if len(problems) > _DESCENTS:
        problems = most_promising(problems, fit, fit.bandwidth)[:_DESCENTS]
    begun = in_threads(lambda each: each.begun(fit), problems)
    ways = [  # those that come by the same place go on alike
        (problem, here)
        for place, (problem, here) in enumerate(zip(problems, begun, strict=True))
        if not any(here.is_at(other.point, fit.samples) for other in begun[:place])
    ]
    return max(in_threads(lambda way: way[0].descend(fit, way[1]), ways), key=lambda found: found.log_likelihood)


def problem_near(fit: Fit, model: ServoModel, fixed: tuple[str, ...] = ()) -> Problem:
    """The problem of fitting another model to a fit's log; what was fixed stays so, as far as the model has it."""
    return Problem.of(fit.log, model, fixed=[name for name in fixed if name in model.names], known=fit.known)


def fitted_near(fit: Fit, model: ServoModel) -> Fit:
    """Another model fitted to a fit's log, from there."""
    return problem_near(fit, model).descend(fit)


def most_promising(problems: list[Problem], fit: Fit, bandwidth: float, iterations: int = 4) -> list[Problem]:
    """The problems by how well a few iterations from a fit serve them, the best first."""
    costs = in_threads(lambda each: each.glance(fit, bandwidth, iterations), problems)
    return [problems[place] for place in np.argsort(costs, kind="stable")]


def follows_anything(fit: Fit) -> bool:
    """Whether the observer is nearly as fast as the sampling."""
    return fit.bandwidth * fit.log.sample_time >= _FAST


def evidence_of(fit: Fit, than: Fit, *, over: float | None = None) -> float:
    """By how much a fit is likelier than a simpler one, each less its charge for a bandwidth.

    Where innovations have a colour, a likelihood ratio counts too much. It is divided by the fit's `widening`, or by
    `over`: rivals are compared with one and the same.

    Where both are chaotic each stands on a peak of a mountain range, and which one it climbed is chance. The rise
    counts as far as it also shows where the range is smooth: behind an observer that holds them.
    """
    charge = 0.5 * float(np.log(fit.samples))
    rise = fit.log_likelihood - than.log_likelihood - charge * ((fit.bandwidth > 0.0) - (than.bandwidth > 0.0))
    if fit.held_log_likelihood is not None and than.held_log_likelihood is not None:
        rise = min(rise, fit.held_log_likelihood - than.held_log_likelihood)
    return rise if rise <= 0.0 else rise / (widening(fit, than) if over is None else over)


def widening(fit: Fit, than: Fit) -> float:
    """Factor by which the innovations' colour widens the variance of the parameters that a fit has more, at least 1.

    It scales the likelihood ratio (Satorra and Bentler 1994).
    """
    more = [row for row, place in enumerate(fit.free) if fit.model.names[place] not in than.model.names]
    if not more:
        return 1.0
    coloured, white = (np.diag(table)[more] for table in (fit.covariance, fit.white_covariance))
    known = white > 0.0
    return max(float(np.exp(np.mean(np.log(coloured[known] / white[known])))), 1.0) if known.any() else 1.0


def estimates(fit: Fit, effect: str) -> dict[str, Estimate]:
    """The estimates of one effect's parameters, as far as they are not stated."""
    own = fit.model.effect(effect)
    if own is None:
        return {}
    lines = {spec.name: fit[f"{effect}.{spec.name}"] for spec in own.parameters() if spec.fitted or own.freed}
    return {
        name: Estimate(value=float(getattr(own, name)), std=line.std, unit=line.unit) for name, line in lines.items()
    }


def is_plausible(fit: Fit, name: str) -> bool:
    """Whether a fitted effect came out with values such as its cause can well have, on that log."""
    effect = fit.model.effect(name)
    if effect is None:
        return True
    angles = np.concatenate([run.output[run.valid] for run in fit.log.runs])
    ends = {"low": float(angles.min()), "high": float(angles.max())}
    return effect.plausible(**ends, speed=typical_speed(fit), inertia=fit.model.inertia, turn=turn_of(fit.model.axis))


def is_its_special_case(fit: Fit, name: str) -> bool:
    """Whether the shape of a fitted effect vanishes, so that nothing shows what a simpler effect would not show too."""
    effect = fit.model.effect(name)
    return effect is not None and bool(effect.reduced()) and effect.vanishes(typical_speed(fit), fit.log.sample_time)
