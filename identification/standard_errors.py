"""From a least-squares minimum to a fit: standard errors, and the parameters that the data do not determine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identification.fit_result import Fit, FittedParameter
from identification.least_squares import Minimum, uncertainty
from identification.noise import log_likelihood
from identification.objective import Objective
from identification.observer_steps import FADING
from identification.predictor import Prediction
from identification.prior import natural_scales
from identification.sums_over_runs import informations
from plant.effects.effect import Array
from plant.servo import ServoModel

_ASIDE = 0.1  # step of ln(bandwidth) for the curvature of the likelihood


def fit_with_errors(objective: Objective, bandwidth: float, minimum: Minimum, evaluations: int) -> Fit:
    """The fit at a minimum of an objective at a bandwidth [rad/s]; `evaluations` are earlier passes over the log."""
    values, initial = objective.unpack(minimum.point)
    degrees = max(objective.samples - minimum.point.size, 1)
    count = len(objective.free)
    predictions = objective.predictor.predict(values, initial, bandwidth=bandwidth, width=0.0)
    innovations = np.concatenate([p.innovations for p in predictions])
    around = _around(objective, values, initial, bandwidth, predictions)
    with np.errstate(over="ignore", invalid="ignore"):
        variance = float(sum(p.innovations @ p.innovations for p in around)) / degrees
        white, coloured = informations(around)
        if objective.prior is not None:
            white[:count, :count] += variance * objective.prior.precision
            coloured[:count, :count] += variance**2 * objective.prior.precision
    found = uncertainty(white, coloured, variance)
    spread, lost = found.covariance[:count, :count], found.undetermined[:count]
    if _nothing_moves(objective, minimum):
        lost, values = np.ones(count, dtype=bool), objective.model.values
    else:
        values, initial = _where_it_began(objective, minimum.point, found.null_projection)
    lost = lost | _without_weight(objective, values, np.sqrt(np.maximum(np.diag(spread), 0.0)))
    fitted = objective.model.with_values(values)
    return Fit(
        model=fitted,
        parameters=_lines(objective, fitted, spread, lost),
        free=objective.free,
        covariance=spread,
        white_covariance=found.white[:count, :count],
        initial=initial,
        bandwidth=bandwidth,
        noise_std=float(np.sqrt(minimum.equations.cost / objective.loss(minimum.point) / degrees)),
        log_likelihood=log_likelihood(minimum.equations.cost, objective.samples),
        samples=objective.samples,
        innovations=innovations,
        substeps=objective.predictor.substeps,
        converged=minimum.converged,
        evaluations=evaluations + minimum.evaluations,
        log=objective.log,
        known=objective.known,
    )


def _where_it_began(objective: Objective, point: Array, null_projection: Array) -> tuple[Array, Array]:
    """Parameters and initial states of a point, moved back to the start along the undetermined directions only.

    If two parameters are confounded, their well-determined combination is unchanged.
    """
    count = len(objective.free)
    way = np.zeros_like(point)
    way[:count] = point[:count] - objective.model.values[list(objective.free)]
    return objective.unpack(np.clip(point - null_projection @ way, objective.lower, objective.upper))


def divergent_fit(objective: Objective, initial: Array, bandwidth: float, evaluations: int) -> Fit:
    """The result for a model that is unstable in every attempt to fit it: log-likelihood minus infinity."""
    count = len(objective.free)
    nothing = np.zeros((count, count))
    return Fit(
        model=objective.model,
        parameters=_lines(objective, objective.model, nothing, np.ones(count, dtype=bool)),
        free=objective.free,
        covariance=nothing,
        white_covariance=nothing,
        initial=initial,
        bandwidth=bandwidth,
        noise_std=np.inf,
        log_likelihood=-np.inf,
        samples=objective.samples,
        innovations=np.zeros(sum(len(run) for run in objective.log.runs)),
        substeps=objective.predictor.substeps,
        converged=False,
        evaluations=evaluations,
        log=objective.log,
        known=objective.known,
        held_log_likelihood=-np.inf if objective.model.chaotic else None,
    )


def bandwidth_std(fit: Fit) -> float | None:
    """Standard error of a fit's bandwidth [rad/s], the other parameters fixed, from finite differences.

    The log-likelihood over ln(bandwidth) is nearly a parabola; its curvature is the inverse of the variance. None if
    the fit has no observer, or if its bandwidth is not a maximum but an end of the range.
    """
    if not fit.bandwidth:
        return None
    objective = Objective.of(fit.log, fit.model, known=fit.known)
    point = objective.pack(fit.model.values, fit.initial)
    slower, here, faster = (
        log_likelihood(objective.cost(point, fit.bandwidth * np.exp(step), 0.0), fit.samples)
        for step in (-_ASIDE, 0.0, _ASIDE)
    )
    curvature = (2.0 * here - slower - faster) / _ASIDE**2
    return float(fit.bandwidth / np.sqrt(curvature)) if curvature > 0.0 else None


def _around(
    objective: Objective, values: Array, initial: Array, bandwidth: float, here: list[Prediction]
) -> list[Prediction]:
    """Innovations and Jacobians for the standard errors.

    The likelihood of a chaotic model at a low bandwidth has many maxima, and the curvature of the highest one does not
    show the others. A sufficiently fast observer smooths the likelihood, unless impacts in quick succession make the
    sensitivities grow without bound; then the curvature of the highest maximum is used.
    """
    fading = FADING / objective.log.sample_time
    if not objective.model.chaotic or bandwidth >= fading:
        return here
    smooth = objective.predictor.predict(values, initial, bandwidth=fading, width=0.0)
    with np.errstate(over="ignore", invalid="ignore"):
        bounded = all(np.isfinite(p.jacobian.T @ p.jacobian).all() for p in smooth)
    return smooth if bounded else here


def _nothing_moves(objective: Objective, minimum: Minimum) -> bool:
    """Whether a constant output explains the log as well as the fitted motion: no parameter is identifiable.

    The rigid body has no constant torque: for an inverse model the constant is zero.
    """
    seen = [run.measured[run.valid] for run in objective.log.runs]
    still = sum(float(np.sum((each - (objective.log.response != "torque") * each.mean()) ** 2)) for each in seen)
    return still <= 1.1 * minimum.equations.cost


def _without_weight(objective: Objective, values: Array, std: Array) -> NDArray[np.bool_]:
    """(F,) parameters with an uncertainty larger than their scale: the data do not determine them.

    For a rigid-body parameter the scale is the value whose torque over the log's motion is the torque of the log (rms).
    For any parameter it is at least the fitted value, and the natural scale of its quantity on the log.
    """
    natural = natural_scales(objective.log)
    level = natural["N m"]
    speeds = np.concatenate([np.gradient(run.output, run.time) for run in objective.log.runs])
    speed = float(np.sqrt(np.nanmean(speeds**2)))
    slowest = 2.0 * np.pi / max(run.duration for run in objective.log.runs)
    typical = {"inertia": slowest * speed, "gravity": 1.0, "viscous_friction": speed}
    lost = np.zeros(len(objective.free), dtype=bool)
    for row, place in enumerate(objective.free):
        name = objective.model.names[place]
        scale = max(
            abs(values[place]),
            level / typical[name] if typical.get(name) else 0.0,
            natural.get(objective.model.quantities[place], 0.0),
        )
        lost[row] = std[row] > scale and not _at_bound(objective, row, values[place])
    return lost


def _at_bound(objective: Objective, row: int, value: float) -> bool:
    return bool(value <= objective.lower[row] or value >= objective.upper[row])


def _lines(
    objective: Objective, fitted: ServoModel, spread: Array, lost: NDArray[np.bool_]
) -> tuple[FittedParameter, ...]:
    lines = []
    for place, (spec, value) in enumerate(zip(fitted.parameters, fitted.values, strict=True)):
        line = FittedParameter(
            name=spec.name,
            value=float(value),
            std=None,
            unit=spec.unit,
            start=float(objective.model.values[place]),
            fixed=place not in objective.free,
        )
        if place in objective.free:
            row = objective.free.index(place)
            known = not lost[row]
            line = replace(
                line,
                value=float(value) if known else None,
                std=float(np.sqrt(spread[row, row])) if known else None,
                at_bound=known and _at_bound(objective, row, float(value)),
            )
        lines.append(line)
    return tuple(lines)
