"""The equations of the estimator: one sample of the Kalman filter, and its start."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mpc.prediction import Predictor
from mpc.status import Trouble
from plant.effects import State
from plant.servo import ServoModel

_OUTLIER = 10.0
"""Innovations above this number of standard deviations are rejected as outliers."""

_REJECTED_AT_MOST = 3
"""After this number of outliers in a row the filter restarts."""

_ITERATIONS = 20
"""Iterations for the angle at which the sensor shows a measurement; each divides the error by ten or more."""

_UNKNOWN = 1e4
"""Variance of a motor's offset before its first measurement, and after a jump of it [rad^2]."""

_LARGEST = float(np.finfo(np.float64).max)


def kalman_of(n: int, motors: bool) -> Any:
    """State of the filter, as symbols."""
    m = n + 1 + 2 * motors
    return ca.SX.sym("kalman", 2 + m + m * (m + 1) // 2)


def place_of_covariance(m: int) -> slice:
    """Position in the filter's state of the covariance of state, disturbance and offsets (m,)."""
    return slice(2 + m, 2 + m + m * (m + 1) // 2)


def covariance_of(kalman: NDArray[np.float64], m: int) -> NDArray[np.float64]:
    """(m, m) covariance of state, disturbance and offsets."""
    upper = np.zeros((m, m))
    upper[np.tril_indices(m)[::-1]] = kalman[place_of_covariance(m)]
    return upper + np.triu(upper, 1).T


def _levels(motors: bool) -> Any:
    return ca.SX.sym("levels", 9 if motors else 4)


def _triangle(n: int) -> Any:
    return ca.Sparsity.upper(n)


def estimation(predictor: Predictor, motors: bool) -> Any:
    """One sample of the filter, as a `casadi.Function`.

    (state, measurements: angle and motor angles if any, [torque since the last sample, torque before, dead band of the
    innovation], parameters, levels) -> state, trouble (see `Trouble`), whether to restart.
    """
    model = predictor.model
    n, p = len(model.states), ca.SX.sym("parameters", predictor.parameters.size)
    kalman, measurements, acted = kalman_of(n, motors), ca.SX.sym("measurements", 1 + 2 * motors), ca.SX.sym("acted", 3)
    levels, m, measurement = _levels(motors), n + 1 + 2 * motors, measurements[0]
    known, rejected, d, z, offsets = kalman[0], kalman[1], kalman[2], kalman[3 : 3 + n], kalman[3 + n : 2 + m]
    variance, torque_noise, drift = ca.vertsplit(levels)[:3]
    covariance = ca.triu2symm(ca.SX(_triangle(m), kalman[2 + m :]))

    # Predict.
    ahead, by_state, by_torque = predictor.stage(z, acted[:2] + d, p)
    F = ca.SX.eye(m)
    F[:n, :n], F[:n, n] = by_state, ca.sum2(by_torque)
    dt, kick = p[-1], p[-1] / p[0] * torque_noise
    slips = [levels[6] ** 2 * dt] * 2 if motors else []
    added = ca.vertcat((kick * dt / 2) ** 2, kick**2, ca.SX(n - 2, 1), drift**2 * dt, *slips)
    spread = ca.mtimes(ca.mtimes(F, covariance), F.T) + ca.diag(added)
    shown, slope = predictor.sensor(ahead, p)
    row = ca.vertcat(slope, ca.SX(m - n, 1))
    expected = ca.mtimes(row.T, ca.mtimes(spread, row)) + variance
    innovation = measurement - shown
    innovation -= ca.fmax(ca.fmin(innovation, acted[2]), -acted[2])

    # Classify the measurement and the prediction.
    sound, received = finite(ca.vertcat(ahead, ca.triu(spread).nz[:])), finite(measurement)
    wild = ca.fabs(innovation) > _OUTLIER * ca.sqrt(expected) + levels[3]
    wilder = rejected + 1
    cases = [
        (ca.logic_and(ca.logic_not(ca.logic_and(known, sound)), ca.logic_not(received)), Trouble.NO_ANGLE, False),
        (ca.logic_not(known), Trouble.NONE, True),
        (ca.logic_not(sound), Trouble.ESTIMATE_DIVERGED, True),
        (ca.logic_not(received), Trouble.ANGLE_PREDICTED, False),
        (ca.logic_and(wild, wilder >= _REJECTED_AT_MOST), Trouble.ESTIMATE_RESTARTED, True),
        (wild, Trouble.ANGLE_JUMPED, False),
    ]
    trouble, anew = ca.SX(Trouble.NONE), ca.SX(0)
    for holds, name, begins in reversed(cases):
        trouble, anew = ca.if_else(holds, int(name), trouble), ca.if_else(holds, int(begins), anew)
    believed = ca.logic_and(received, ca.logic_not(wild))
    rejected = ca.if_else(received, ca.if_else(wild, wilder, 0), rejected)

    # Correct by the load encoder and then by each motor encoder.
    x = ca.vertcat(ahead, d, offsets)
    x, spread = _corrected(x, spread, row, innovation, variance, believed)
    for i in range(2 * motors):
        row = _motor_row(model, m, i)
        innovation = -measurements[1 + i] / levels[7 + i] - ca.dot(row, x)
        expected = ca.mtimes(row.T, ca.mtimes(spread, row)) + levels[4 + i]
        received = finite(measurements[1 + i])
        near = ca.fabs(innovation) <= _OUTLIER * ca.sqrt(expected)
        jumped = ca.logic_and(received, ca.logic_not(near))
        x, spread = _corrected(x, spread, row, innovation, levels[4 + i], ca.logic_and(received, near))
        spread[n + 1 + i, n + 1 + i] += ca.if_else(jumped, _UNKNOWN, 0)
    memory = ca.vertcat(ca.logic_and(known, sound), rejected, x[n], x[:n], x[n + 1 :], ca.triu(spread).nz[:])
    inputs = [kalman, measurements, acted, p, levels]
    return ca.Function("estimate", inputs, [ca.densify(memory), trouble, anew], {"cse": True})


def _corrected(x: Any, spread: Any, row: Any, innovation: Any, variance: Any, believed: Any) -> tuple[Any, Any]:
    """Measurement update if the measurement is accepted; in Joseph form, which keeps P symmetric and positive."""
    gain = ca.mtimes(spread, row) / (ca.mtimes(row.T, ca.mtimes(spread, row)) + variance)
    keep = ca.SX.eye(x.shape[0]) - ca.mtimes(gain, row.T)
    sharper = ca.mtimes(ca.mtimes(keep, spread), keep.T) + ca.mtimes(gain, gain.T) * variance
    return ca.if_else(believed, x + gain * innovation, x), ca.if_else(believed, sharper, spread)


def _motor_row(model: ServoModel, m: int, i: int) -> Any:
    """(m,) measurement row of motor i, at the load: motor angle (load angle in a rigid drivetrain) plus its offset."""
    row = ca.SX(m, 1)
    row[motor_place(model)], row[m - 2 + i] = 1, 1
    return row


def motor_place(model: ServoModel) -> int:
    """Index of the state that is the motor angle; 0, the load angle, if the drivetrain is rigid."""
    kinds = [kind if effect.flexible else None for effect in model.effects for kind in effect.states]
    return 2 + kinds.index(State.ANGLE) if State.ANGLE in kinds else 0


def beginning(predictor: Predictor, motors: bool) -> Any:
    """Start at rest, as a `casadi.Function`: (measurements, torque, parameters, levels) -> filter state."""
    model = predictor.model
    n, p = len(model.states), ca.SX.sym("parameters", predictor.parameters.size)
    measurements, torque, levels = ca.SX.sym("measurements", 1 + 2 * motors), ca.SX.sym("torque"), _levels(motors)
    state = _at_rest(model.bound(p[:-1]), measurements[0], torque)
    level = levels[1] + levels[2]
    known: dict[State, Any] = {State.ANGLE: ca.sqrt(levels[0]), State.VELOCITY: 1.0}
    spread = [known.get(kind, level) ** 2 for kind in model.kinds] + [level**2]
    received = [finite(measurements[1 + i]) for i in range(2 * motors)]
    offsets = [ca.if_else(h, -measurements[1 + i] / levels[7 + i] - state[0], 0) for i, h in enumerate(received)]
    spread += [ca.if_else(h, levels[0] + levels[4 + i], _UNKNOWN) for i, h in enumerate(received)]
    covariance = ca.densify(ca.diag(ca.vertcat(*spread)))
    for i, h in enumerate(received):  # the errors of offset and angle are correlated
        covariance[0, n + 1 + i] = ca.if_else(h, -levels[0], 0)
    if motors:
        covariance[n + 1, n + 2] = ca.if_else(ca.logic_and(*received), levels[0], 0)
    kalman = ca.vertcat(1, 0, 0, state, *offsets, covariance[_triangle(len(spread))].nz[:])
    return ca.Function("begin", [measurements, torque, p, levels], [ca.densify(kalman)], {"cse": True})


def _at_rest(model: ServoModel, measurement: Any, torque: Any) -> Any:
    """(n,) state at rest with the sensor settled at a measurement [rad], by fixed-point iteration.

    A systematic sensor error of a fraction of a degree is many times the noise. To start with the measurement as the
    angle would be inconsistent with the sensor model, and the filter would not recover.
    """
    angle = measurement
    for _ in range(_ITERATIONS):
        values = {State.ANGLE: angle, State.TORQUE: torque, State.COMMAND: torque}
        state = [values.get(kind, 0.0) for kind in model.kinds]
        shown, place = angle, 2
        for effect in model.effects:
            if State.ANGLE in effect.states and not effect.flexible:
                state[place] = shown
            shown = effect.measurement(shown, shown)
            place += len(effect.states)
        if ca.is_equal(ca.SX(shown), ca.SX(angle)):
            break
        angle = angle + (measurement - shown)
    return ca.vertcat(*state)


def finite(values: Any) -> Any:
    """Whether all of (m,) expressions are finite numbers: NaN fails every comparison."""
    return ca.sum1(ca.fabs(values)) <= _LARGEST
