"""Fits of models that start from another fit, and estimates of one effect from a fit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from diagnosis.motion import turn_of
from diagnosis.result import Estimate
from identification.fit_result import Fit
from identification.least_squares import Minimum
from identification.log import Log
from identification.problem import Problem, first_states
from identification.standard_errors import fit_with_errors
from identification.threads import in_threads
from identification.unsettled_start import unsettled_if_shown
from plant.effects import Effect
from plant.effects.effect import Covered
from plant.servo import ServoModel

_MANY = 12  # largest number of starts that are fitted for an iteration
_FEW = 4  # and for a few


def problem_near(fit: Fit, model: ServoModel, fixed: tuple[str, ...] = ()) -> Problem:
    """The problem of fitting another model to a fit's log; names in `fixed` that the model lacks are ignored."""
    return Problem.of(fit.log, model, fixed=[name for name in fixed if name in model.names], known=fit.known)


def settled(fit: Fit, bandwidth: float) -> Fit:
    """The same model, fitted with the observer that it needs: from a bandwidth [rad/s] down while the fit improves."""
    found = problem_near(fit, fit.model).descend(replace(fit, bandwidth=max(fit.bandwidth, bandwidth)))
    return found if found.converged else fit


def without(fit: Fit, effect: str, bandwidth: float) -> Fit:
    """The model without one effect, fitted again in the same way."""
    problem = problem_near(fit, fit.model.without_effect(effect))
    return problem.descend(replace(fit, bandwidth=max(fit.bandwidth, bandwidth)))


def fitted_to(log: Log, fit: Fit) -> Fit:
    """The model of a fit, fitted to another log with the same observer; fixed parameters stay fixed."""
    kept = [p.name for p in fit.parameters if p.fixed]
    problem = Problem.of(replace(log, colour=fit.log.colour), fit.model, fixed=kept, known=fit.known)
    found = problem.minimise(problem.pack(fit.model.values, first_states(log)), fit.bandwidth, 0.0)
    return fit_with_errors(problem, fit.bandwidth, found, found.evaluations)


def fitted_from(start: Fit, problem: Problem, iterations: int = 30, begun: Minimum | None = None) -> Fit:
    """The fit of a problem with the observer of another fit, from there or from a minimisation in progress."""
    begun = problem.begun(start, start.bandwidth) if begun is None else begun
    ended = problem.minimise(begun.point, start.bandwidth, 0.0, iterations=iterations, at_start=begun.equations)
    problem, ended = unsettled_if_shown(problem, ended, start.bandwidth)
    return fit_with_errors(problem, start.bandwidth, ended, begun.evaluations)


def most_promising(problems: list[Problem], fit: Fit, bandwidth: float, iterations: int = 4) -> list[Problem]:
    """The problems in order of their cost after a few iterations from a fit, the best first.

    Of more than 12 only those with the lowest initial cost are tried, of more than 4 those with the lowest cost after
    one iteration.
    """

    def ranked(after: int) -> list[Problem]:
        costs = in_threads(lambda each: each.glance(fit, bandwidth, after), problems)
        return [problems[place] for place in np.argsort(costs, kind="stable")]

    for most, after in ((_MANY, 0), (_FEW, 1)):
        if len(problems) > most:
            problems = ranked(after)[:most]
    return ranked(iterations)


def estimates(fit: Fit, effect: str) -> dict[str, Estimate]:
    """The estimates of one effect's fitted parameters."""
    own = fit.model.effect(effect)
    if own is None:
        return {}
    lines = {spec.name: fit[f"{effect}.{spec.name}"] for spec in own.parameters() if spec.fitted or own.freed}
    return {
        name: Estimate(value=float(getattr(own, name)), std=line.std, unit=line.unit) for name, line in lines.items()
    }


def typical_speed(fit: Fit) -> float:
    """90 % quantile of the speed in the log [rad/s]."""
    speed = np.concatenate([np.diff(run.output) / np.diff(run.time) for run in fit.log.runs])
    return float(np.quantile(np.abs(speed), 0.9))


def is_plausible(fit: Fit, name: str) -> bool:
    """Whether an effect has plausible values, or would have with one parameter moved by two standard errors."""
    effect = fit.model.effect(name)
    if effect is None:
        return True
    angles = np.concatenate([run.output[run.valid] for run in fit.log.runs])
    time = np.concatenate([run.time[run.valid] for run in fit.log.runs])
    gone = np.cumsum(np.abs(np.diff(angles, prepend=angles[0])))

    def travelled(instant: float) -> tuple[float, float]:
        before = float(np.interp(instant, time, gone))
        return before, float(gone[-1]) - before

    covered = Covered(
        low=float(angles.min()),
        high=float(angles.max()),
        speed=typical_speed(fit),
        duration=max(float(run.time[-1] - run.time[0]) for run in fit.log.runs),
        inertia=fit.model.inertia,
        turn=turn_of(fit.model.axis),
        travelled=travelled,
    )
    return any(each.plausible(covered) for each in (effect, *_equally_likely(fit, effect)))


def _equally_likely(fit: Fit, effect: Effect) -> Iterator[Effect]:
    """The effect with one parameter at a time two standard errors lower or higher.

    Empty for a flexible drivetrain: in doubt it is a lag, so the log has to show its resonance.
    """
    if effect.flexible:
        return
    for spec in effect.parameters():
        std = fit[f"{effect.name}.{spec.name}"].std or 0.0
        for away in (-2.0 * std, 2.0 * std) if std else ():
            value = float(np.clip(getattr(effect, spec.name) + away, spec.lower, spec.upper))
            yield replace(effect, **{spec.name: value})


def is_its_special_case(fit: Fit, name: str) -> bool:
    """Whether a fitted effect has reduced to a simpler one, its special case."""
    effect = fit.model.effect(name)
    return effect is not None and bool(effect.reduced()) and effect.vanishes(typical_speed(fit), fit.log.sample_time)
