"""From a least-squares minimum to a fit: how sure each parameter is, and which of them the data cannot tell."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from identification.fit_result import Fit, FittedParameter
from identification.least_squares import Minimum, uncertainty
from identification.noise import log_likelihood
from identification.over_runs import informations
from identification.predictor import FADING, Prediction
from plant.effects.effect import Array
from plant.servo import ServoModel

if TYPE_CHECKING:
    from identification.problem import Problem


def fit_of(problem: Problem, bandwidth: float, minimum: Minimum, evaluations: int) -> Fit:
    """The fit that a minimum of a problem at a bandwidth [rad/s] amounts to, after so many passes over the log."""
    values, initial = problem.unpack(minimum.point)
    degrees = max(problem.samples - minimum.point.size, 1)
    predictions = problem.predictor.predict(values, initial, bandwidth=bandwidth, width=0.0)
    innovations = np.concatenate([p.innovations for p in predictions])
    around = _around(problem, values, initial, bandwidth, predictions)
    power = float(sum(p.innovations @ p.innovations for p in around))
    found = uncertainty(*informations(around), power / degrees)
    count = len(problem.free)
    spread, lost = found.covariance[:count, :count], found.undetermined[:count]
    lost = lost | _nothing_moves(problem, minimum)
    gone = np.array(problem.free, dtype=int)[lost]
    values[gone] = problem.model.values[gone]
    lost = lost | _without_weight(problem, values, np.sqrt(np.diag(spread)))
    fitted = problem.model.with_values(values)
    return Fit(
        model=fitted,
        parameters=_lines(problem, fitted, spread, lost),
        free=problem.free,
        covariance=spread,
        white_covariance=found.white[:count, :count],
        initial=initial,
        bandwidth=bandwidth,
        noise_std=float(np.sqrt(minimum.equations.cost / degrees)),
        log_likelihood=log_likelihood(minimum.equations.cost, problem.samples),
        samples=problem.samples,
        innovations=innovations,
        substeps=problem.predictor.substeps,
        converged=minimum.converged,
        evaluations=evaluations + minimum.evaluations,
        log=problem.log,
    )


def _around(
    problem: Problem, values: Array, initial: Array, bandwidth: float, here: list[Prediction]
) -> list[Prediction]:
    """Innovations and Jacobians whose curvature says how sure the fit is.

    Where a model is chaotic the likelihood at a low bandwidth is a mountain range, and the curvature of its highest
    peak says nothing of the others. An observer that is faster than the chaos smooths it.
    """
    chaotic = any(effect.chaotic for effect in problem.model.effects)
    if not chaotic or bandwidth >= FADING:
        return here
    return problem.predictor.predict(values, initial, bandwidth=FADING, width=0.0)


def _nothing_moves(problem: Problem, minimum: Minimum) -> bool:
    """Whether an output that never changes explains the log as well as the fitted motion: nothing can be told."""
    still = sum(float(np.sum((run.output - run.output[run.valid].mean())[run.valid] ** 2)) for run in problem.log.runs)
    return still < 1.1 * minimum.equations.cost


def _without_weight(problem: Problem, values: Array, std: Array) -> NDArray[np.bool_]:
    """(F,) parameters whose uncertainty is worth more than the torque in the log: the data cannot tell them.

    What a standard error is worth is the torque that it makes over the log's motion; for the parameters of an
    effect, whose torque is not known before it is named, the value itself is the scale.
    """
    torque = np.concatenate([run.command - run.servo_gain * run.output for run in problem.log.runs])
    level = float(np.sqrt(np.nanmean(torque**2)))
    speeds = np.concatenate([np.gradient(run.output, run.time) for run in problem.log.runs])
    speed = float(np.sqrt(np.nanmean(speeds**2)))
    slowest = 2.0 * np.pi / max(run.duration for run in problem.log.runs)
    worth = {"inertia": slowest * speed, "gravity": 1.0, "viscous_friction": speed}
    viscous = level / speed if speed > 0.0 else 0.0
    # Of an effect's parameter that may well be zero.
    natural = {"rad": 1.0, "N m": level, "N": level, "N m s/rad": viscous, "N s/m": viscous}
    lost = np.zeros(len(problem.free), dtype=bool)
    for row, place in enumerate(problem.free):
        name = problem.model.names[place]
        scale = max(
            abs(values[place]),
            level / worth[name] if worth.get(name) else 0.0,
            natural.get(problem.model.parameters[place].unit, 0.0),
        )
        lost[row] = std[row] > scale and not _at_bound(problem, row, values[place])
    return lost


def _at_bound(problem: Problem, row: int, value: float) -> bool:
    return bool(value <= problem.lower[row] or value >= problem.upper[row])


def _lines(problem: Problem, fitted: ServoModel, spread: Array, lost: NDArray[np.bool_]) -> tuple[FittedParameter, ...]:
    lines = []
    for place, (spec, value) in enumerate(zip(fitted.parameters, fitted.values, strict=True)):
        line = FittedParameter(
            name=spec.name,
            value=float(value),
            std=None,
            unit=_in_command_units(spec.unit, problem.log.command_unit),
            start=float(problem.model.values[place]),
            fixed=place not in problem.free,
        )
        if place in problem.free:
            row = problem.free.index(place)
            known = not lost[row]
            line = replace(
                line,
                value=float(value) if known else None,
                std=float(np.sqrt(spread[row, row])) if known else None,
                at_bound=known and _at_bound(problem, row, float(value)),
            )
        lines.append(line)
    return tuple(lines)


def _in_command_units(unit: str, command_unit: str) -> str:
    """A parameter's unit where the log's command is not a torque but volts or amperes of unknown scale."""
    if command_unit in ("N m", "N"):
        return unit
    return unit.replace("kg m^2", "N m s^2/rad").replace("kg", "N s^2/m").replace("N m", command_unit)
