"""The motion of a fitted model, along which the signatures of effects are calculated."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from identification.fit_result import Fit
from identification.observer_gain import correcting_gain
from identification.predictor import Prediction
from identification.problem import Problem
from identification.run import Run
from plant.discrete import Structure
from plant.effects import Motion
from plant.effects.effect import POSITIVE, TURN, Array, Axis
from plant.recursion_cache import recursion
from plant.servo import ServoModel


def motion_of(
    fit: Fit, problem: Problem, predictions: list[Prediction], bandwidth: float, scores: tuple[Array, Array]
) -> Motion:
    """The model's motion, from which effects calculate their regressors.

    The torque of a position servo is calculated from its measurement and from the speed of this motion. A derivative of
    the measurement would contain the noise of later samples and could explain it.
    """
    runs = problem.log.runs
    velocity = np.concatenate([p.states[1] for p in predictions])
    # what depends on the torque itself must not explain it: for an inverse model it is the predicted one
    inverse = problem.log.response == "torque"
    command = np.concatenate([p.output if inverse else run.command for run, p in zip(runs, predictions, strict=True)])
    gain = np.concatenate([run.servo_gain for run in runs])
    damping = np.concatenate([run.servo_damping for run in runs])
    returned = gain * np.concatenate([run.output for run in runs]) + damping * velocity
    limit = np.repeat([run.command_limit for run in runs], [len(run) for run in runs])

    def law(command: Array) -> Array:
        return np.asarray(np.clip(command - returned, -limit, limit))

    dt = runs[0].sample_time
    typical, fastest = np.quantile(np.abs(velocity), [0.9, 1.0])
    resolution = 0.0 if inverse else fit.noise_std * bandwidth * np.sqrt(bandwidth * dt)
    return Motion(
        time=np.concatenate([run.time for run in runs]),
        angle=np.concatenate([p.states[0] for p in predictions]),
        velocity=velocity,
        acceleration=np.concatenate([_acceleration(r, p, bandwidth) for r, p in zip(runs, predictions, strict=True)]),
        command=command,
        servo_gain=gain,
        torque=law(command),
        score=scores[0],
        reading_score=scores[1],
        inertia=float(fit.model.inertia),
        law=law,
        arriving=lambda torque: _arriving(fit.model, torque, velocity),
        run=np.repeat(np.arange(len(runs)), [len(run) for run in runs]),
        velocity_resolution=float(max(1e-3 * typical, 1e-9 * fastest, resolution, POSITIVE)),
        turn=turn_of(fit.model.axis),
    )


def turn_of(axis: Axis) -> float:
    """One turn of the load [rad]; 0 on a linear axis."""
    return TURN if axis == "rotary" else 0.0


def _arriving(model: ServoModel, torque: Array, velocity: Array) -> Array:
    """(T,) torque at the load for a commanded torque (T,), in steady state of all lags [N m]."""
    return _settled(Structure(model))((), np.column_stack((torque, velocity)), model.values)[1][0][:, 0]


@recursion(carried=0)
def _settled(structure: Structure) -> Any:
    row, parameters = ca.SX.sym("row", 2), ca.SX.sym("parameters", len(structure.model.names))
    torque: Any = row[0]
    for effect in structure.model.bound(parameters).effects:
        torque = effect.command(torque, torque, row[1])
    return ca.Function("settled", [row, parameters], [torque])


def _acceleration(run: Run, prediction: Prediction, bandwidth: float) -> Array:
    """(T,) acceleration of the model over each sample [rad/s^2], without the jumps of the observer's corrections."""
    if run.acceleration is not None:
        return run.acceleration
    dt = np.diff(run.time)
    corrected = prediction.states[1] + correcting_gain(run, bandwidth, np.append(dt, dt[-1]))[1] * prediction.errors
    steps = (prediction.states[1, 1:] - corrected[:-1]) / dt
    return np.append(steps, steps[-1])
