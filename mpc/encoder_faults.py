"""Detection of encoder faults: an encoder that is frozen while the load moves, or contradicts the others.

A wrong but finite value (broken cable, frozen value on a bus) is more dangerous than a missing one: the load seems to
stand still at any torque, and the torque rises. Each of these observations counts as a fault:

- The measurement of the load is constant to the last bit, although the load was too fast to be stopped in that time by
  the full torque and an equally large friction together.
- It is constant to the last bit under the full torque for eight samples, and for so long that even a load with a
  friction of four fifths of that torque would visibly move.
- Over eight samples, or since it has been constant to the last bit, the load encoder has moved by another angle than
  both motors, and these agree; or the motor encoders are constant to the last bit while the load encoder moves.

A faulty measurement is treated as missing until it changes again and agrees with the motors.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mpc.estimator import Estimator
from mpc.filter import finite, kalman_of, motor_place
from mpc.prediction import Predictor

Array = NDArray[np.float64]

WINDOW = 8
"""Samples over which encoders are compared, and for which the full torque has to act."""

_FREE = 2 * WINDOW  # samples of free simulation while the measurement is constant; more under torque
_FULL, _SOME = 0.9, 0.5  # shares of the greatest torque: full torque, and torque that extends the free simulation
_STUCK = 0.8  # of the greatest torque: friction above which a load counts as jammed
_SANE = 4.0  # of that torque: limit of acting torque plus disturbance for a valid memory
_CLEAR = 10.0  # standard deviations
_SOON = 0.8  # share of _CLEAR, so that the fault is detected before the filter restarts

_NUMBERS = ("turn", "tolerance", "noticed", "near", "apart", "beside", "brake", "greatest", "ratio_1", "ratio_2")
WATCHING = len(_NUMBERS)
"""Number of parameters of the fault detection, see `numbers`."""

_OWN = ("last", "same", "pushed", "doubted")  # memory besides the free simulation and the histories


def watched_of(n: int, motors: bool) -> int:
    """Size of the memory for n states, see `watch`."""
    return len(_OWN) + n + 1 + 4 * (WINDOW + 1) * motors


def numbers(estimator: Estimator, turn: float, greatest: float, brake: float, *, held: bool) -> Array:
    """(WATCHING,) parameters of the fault detection.

    Args:
        estimator: of the encoders that are checked.
        turn: angle after which the load encoder wraps around [rad]; zero if it does not.
        greatest: greatest torque on the load [N m].
        brake: greatest deceleration of the load [rad/s^2].
        held: whether a preload couples load and motors; otherwise the motors give no information about the load.
    """
    variance, resolution, motors = float(estimator.levels[0]), estimator.resolution, estimator.motors
    motor_variance, ratios = (max(motors.levels[:2]), motors.ratios) if motors else (0.0, (1.0, 1.0))
    tolerance = resolution + _CLEAR * np.sqrt(variance)
    apart = resolution + _CLEAR * np.sqrt(2 * (variance + motor_variance))
    beside = resolution + _CLEAR * np.sqrt(2 * motor_variance)  # for a constant measurement of the load
    noticed = _SOON * _CLEAR * np.sqrt(variance)
    near = apart if held else 0.0
    apart, beside = (apart, beside) if held else (np.inf, np.inf)
    own = [turn, tolerance, noticed, near, apart, beside, brake, greatest, *ratios]
    return np.array(own, dtype=np.float64)


def watch(predictor: Predictor, motors: bool) -> Any:
    """One sample of the fault detection, as a `casadi.Function`, before that of the filter.

    (state of the filter, measurements, memory, [net torque since the last sample, net torque before, total torque since
    the last sample], parameters, numbers) -> state of the filter, unwrapped measurement, memory, whether the load
    encoder is faulty, whether the motor encoders are. The net torque excludes the friction compensation.

    The memory has the last measurement, the number of samples for which it has been constant, and how many of them in
    a row under the full torque; whether it is faulty; state and disturbance of the free simulation since then; and with
    motor encoders the history of all encoders and of the twist: at the last change of the measurement, and over the
    last samples.
    """
    model, n = predictor.model, len(predictor.model.states)
    kalman, measurements = kalman_of(n, motors), ca.SX.sym("measurements", 1 + 2 * motors)
    watched, acted = ca.SX.sym("watched", watched_of(n, motors)), ca.SX.sym("acted", 3)
    p, own = ca.SX.sym("parameters", predictor.parameters.size), ca.SX.sym("watching", WATCHING)
    turn, tolerance, noticed, near, apart, beside, brake, greatest = ca.vertsplit(own)[:8]
    last, same, pushed, suspected = ca.vertsplit(watched[:4])
    raw, known, z, d = measurements[0], kalman[0], kalman[3 : 3 + n], kalman[2]

    def seen(state: Any, torque: Any) -> tuple[Any, Any]:
        """The next state of the model, and the predicted measurement."""
        ahead = predictor.stage(state, acted[:2] + torque, p)[0]
        return ahead, predictor.sensor(ahead, p)[0]

    # Unwrap to the turn nearest to the prediction.
    predicted, expected = seen(z, d)
    turns = ca.floor((expected - raw) / turn + 0.5)
    angle = raw + ca.if_else(ca.logic_and(ca.logic_and(known, turn > 0), finite(turns)), turn * turns, 0)

    # Free simulation from the estimate at the last change of the measurement.
    whole = ca.fabs(acted[2])
    goes_on = ca.logic_and(same > 0, ca.logic_or(same <= _FREE, whole >= _SOME * greatest))
    free, free_d = ca.if_else(goes_on, watched[4 : 4 + n], z), ca.if_else(goes_on, watched[4 + n], d)
    ahead, shown = seen(free, free_d)
    unchanged = ca.logic_and(known, raw == last)
    sane = ca.fabs(acted[0]) + ca.fabs(free_d) <= _SANE * greatest  # otherwise the memory is invalid
    sane = ca.logic_and(ca.logic_and(sane, finite(ahead)), ca.logic_or(goes_on, kalman[1] == 0))
    same = ca.if_else(ca.logic_and(unchanged, sane), same + 1, 0)
    pushed = ca.if_else(ca.logic_and(unchanged, whole >= _FULL * greatest), pushed + 1, 0)
    off = ca.fabs(shown - angle)
    stopped = ca.logic_and(same <= _FREE, off > tolerance + brake / 2 * (same * p[-1]) ** 2)
    moves = (1 - _STUCK) * brake / 4 * (pushed * p[-1]) ** 2 > tolerance
    jammed = ca.logic_and(ca.logic_and(pushed >= WINDOW, moves), off > tolerance)
    frozen = ca.logic_and(unchanged, ca.logic_and(sane, ca.logic_or(stopped, jammed)))

    leaves, rest, helped, history = ca.SX(0), ca.SX(0), ca.SX(0), ca.SX(0, 1)
    if motors:
        now = ca.vertcat(angle, *(-measurements[1 + i] / own[8 + i] for i in range(2)), z[motor_place(model)] - z[0])
        before = ca.reshape(watched[5 + n :], 4, WINDOW + 1)
        before = ca.if_else(known, before, ca.repmat(now, 1, WINDOW + 1))
        begun = ca.if_else(unchanged, before[:, 0], now)  # at the last change of the load measurement
        curvature = ca.fabs(now - 2 * before[:, 1 + WINDOW // 2] + before[:, 1])
        leaves, rest = _compared(now - before[:, 1], apart, curvature)
        place = predicted[motor_place(model)]
        agrees = [ca.fabs(now[1 + i] - place - kalman[3 + n + i]) < near for i in range(2)]
        leaves = ca.logic_or(
            leaves, ca.logic_and(unchanged, _compared(now - begun, beside, ca.fabs(now - begun) / 2)[0])
        )
        unlikely = ca.logic_and(ca.fabs(expected - angle) > noticed, ca.logic_or(*agrees))
        leaves = ca.logic_or(leaves, ca.logic_and(unchanged, unlikely))
        helped = ca.logic_and(near > 0, ca.logic_or(finite(now[1]), finite(now[2])))
        history = ca.vec(ca.horzcat(begun, before[:, 2:], now))
    out = ca.logic_or(ca.logic_or(frozen, ca.logic_and(leaves, ca.logic_not(rest))), ca.logic_and(suspected, unchanged))
    held_back = ca.logic_and(out, unchanged)
    begins = ca.logic_and(held_back, ca.logic_not(ca.logic_or(suspected, helped)))
    parts = ca.if_else(begins, ca.vertcat(free_d, free), kalman[2 : 3 + n])
    memory = ca.vertcat(raw, same, pushed, out, ahead, free_d, history)
    outputs = [ca.vertcat(kalman[:2], parts, kalman[3 + n :]), angle, ca.densify(memory), out, rest]
    return ca.Function("watch", [kalman, measurements, watched, acted, p, own], outputs, {"cse": True})


def _compared(moved: Any, apart: Any, soft: Any) -> tuple[Any, Any]:
    """Whether load and motor encoders disagree, and whether the motor encoders are frozen, from their motions (4,).

    In a drivetrain softer than the model a motor may lead when it accelerates, by up to `soft` (4,).
    """
    load, *motors, twist = ca.vertsplit(moved)
    received = [finite(motor) for motor in motors]
    own = [motor - twist for motor in motors]
    gone = [ca.fabs(load - motor) > apart + soft[1 + i] for i, motor in enumerate(own)]
    agree = ca.logic_not(ca.logic_and(ca.logic_and(*received), ca.fabs(motors[0] - motors[1]) > apart))
    all_gone = ca.logic_and(*(ca.logic_or(ca.logic_not(h), g) for h, g in zip(received, gone, strict=True)))
    leaves = ca.logic_and(ca.logic_and(ca.logic_or(*received), finite(load)), ca.logic_and(agree, all_gone))
    rest = ca.logic_and(*(ca.logic_or(ca.logic_not(h), motor == 0) for h, motor in zip(received, motors, strict=True)))
    return leaves, ca.logic_and(leaves, ca.logic_and(rest, load != 0))
