"""Whether the sensors can be believed: an encoder that stands still while the load moves, or leaves the others.

A reading that is a number but no measurement (a cable, a frozen value on a bus) is worse than none: the load seems to
stand whatever the torque, and the torque rises until something stops it. Three things cannot be.

- The load's reading is the same to the last bit, while the load was moving too fast to be stopped so soon by a friction
  as strong as the drives against them.
- It is the same to the last bit under the full torque for eight samples, and for so long that even a load that has
  four fifths of that torque in friction would be seen to move.
- Over eight samples, or since it is the same to the last bit, it has gone another way than both motors, which agree;
  or these stand still to the last bit while the load goes.

What is contradicted is left out like a reading that is missing, until it changes again and agrees with the motors.
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

_FREE = 2 * WINDOW  # samples for which the model runs free beside a reading that stands, and longer under torque
_FULL, _SOME = 0.9, 0.5  # of the greatest torque: what counts as full, and as torque at all
_STUCK = 0.8  # of the greatest torque: friction beyond which a load counts as jammed
_SANE = 4.0  # of that torque, what acts and what nobody knows together
_CLEAR = 10.0  # standard deviations
_SOON = 0.8  # of them, so that the filter does not begin anew before

_NUMBERS = ("turn", "tolerance", "noticed", "near", "apart", "beside", "brake", "greatest", "ratio_1", "ratio_2")
WATCHING = len(_NUMBERS)
"""Numbers of the watch, see `numbers`."""

_OWN = ("last", "same", "pushed", "doubted")  # what is remembered beside the free model and the histories


def watched_of(n: int, motors: bool) -> int:
    """How many numbers are remembered for n states, see `watch`."""
    return len(_OWN) + n + 1 + 4 * (WINDOW + 1) * motors


def numbers(estimator: Estimator, turn: float, greatest: float, brake: float, *, held: bool) -> Array:
    """(WATCHING,) numbers of the watch.

    Args:
        estimator: of the encoders that are watched.
        turn: angle after which the load's encoder begins again [rad], zero if it never does.
        greatest: torque on the load [N m].
        brake: greatest acceleration that stops a load [rad/s^2].
        held: whether a preload holds load and motors together; else a motor says nothing of the load.
    """
    variance, resolution, motors = float(estimator.levels[0]), estimator.resolution, estimator.motors
    motor_variance, ratios = (max(motors.levels[:2]), motors.ratios) if motors else (0.0, (1.0, 1.0))
    tolerance = resolution + _CLEAR * np.sqrt(variance)
    apart = resolution + _CLEAR * np.sqrt(2 * (variance + motor_variance))
    beside = resolution + _CLEAR * np.sqrt(2 * motor_variance)  # a load that stands
    noticed = _SOON * _CLEAR * np.sqrt(variance)
    near = apart if held else 0.0
    apart, beside = (apart, beside) if held else (np.inf, np.inf)
    own = [turn, tolerance, noticed, near, apart, beside, brake, greatest, *ratios]
    return np.array(own, dtype=np.float64)


def watch(predictor: Predictor, motors: bool) -> Any:
    """One sample of the watch, as a `casadi.Function`, before that of the filter.

    (state of the filter, readings, what was remembered, torques since the last sample and before without friction and
    the whole one (3,), parameters, numbers) -> that state, reading on its turn, what is remembered, whether the load's
    encoder is contradicted, and whether the motors' are.

    Remembered are the last reading, for how many samples it has been the same, and for how many of them under the full
    torque; whether it is contradicted; state and disturbance of the model that runs free since then; and, where there
    are motors, what each encoder and the twist between load and motor were when the reading was last another one, and
    over the last samples.
    """
    model, n = predictor.model, len(predictor.model.states)
    kalman, readings = kalman_of(n, motors), ca.SX.sym("readings", 1 + 2 * motors)
    watched, acted = ca.SX.sym("watched", watched_of(n, motors)), ca.SX.sym("acted", 3)
    p, own = ca.SX.sym("parameters", predictor.parameters.size), ca.SX.sym("watching", WATCHING)
    turn, tolerance, noticed, near, apart, beside, brake, greatest = ca.vertsplit(own)[:8]
    last, same, pushed, doubted = ca.vertsplit(watched[:4])
    raw, known, z, d = readings[0], kalman[0], kalman[3 : 3 + n], kalman[2]

    def seen(state: Any, torque: Any) -> tuple[Any, Any]:
        """The next state of the model, and what the encoder shows then."""
        ahead = predictor.stage(state, acted[:2] + torque, p)[0]
        return ahead, predictor.sensor(ahead, p)[0]

    # On the turn that is nearest to the prediction.
    predicted, expected = seen(z, d)
    turns = ca.floor((expected - raw) / turn + 0.5)
    angle = raw + ca.if_else(ca.logic_and(ca.logic_and(known, turn > 0), finite(turns)), turn * turns, 0)

    # A model that runs free from the estimate of when the reading was last another one.
    whole = ca.fabs(acted[2])
    goes_on = ca.logic_and(same > 0, ca.logic_or(same <= _FREE, whole >= _SOME * greatest))
    free, free_d = ca.if_else(goes_on, watched[4 : 4 + n], z), ca.if_else(goes_on, watched[4 + n], d)
    ahead, shown = seen(free, free_d)
    stands = ca.logic_and(known, raw == last)
    sane = ca.fabs(acted[0]) + ca.fabs(free_d) <= _SANE * greatest  # else it is the memory that cannot be believed
    sane = ca.logic_and(ca.logic_and(sane, finite(ahead)), ca.logic_or(goes_on, kalman[1] == 0))
    same = ca.if_else(ca.logic_and(stands, sane), same + 1, 0)
    pushed = ca.if_else(ca.logic_and(stands, whole >= _FULL * greatest), pushed + 1, 0)
    off = ca.fabs(shown - angle)
    stopped = ca.logic_and(same <= _FREE, off > tolerance + brake / 2 * (same * p[-1]) ** 2)
    moves = (1 - _STUCK) * brake / 4 * (pushed * p[-1]) ** 2 > tolerance
    jammed = ca.logic_and(ca.logic_and(pushed >= WINDOW, moves), off > tolerance)
    frozen = ca.logic_and(stands, ca.logic_and(sane, ca.logic_or(stopped, jammed)))

    leaves, rest, helped, history = ca.SX(0), ca.SX(0), ca.SX(0), ca.SX(0, 1)
    if motors:
        now = ca.vertcat(angle, *(-readings[1 + i] / own[8 + i] for i in range(2)), z[motor_place(model)] - z[0])
        before = ca.reshape(watched[5 + n :], 4, WINDOW + 1)
        before = ca.if_else(known, before, ca.repmat(now, 1, WINDOW + 1))
        begun = ca.if_else(stands, before[:, 0], now)  # when the reading of the load was last another one
        bent = ca.fabs(now - 2 * before[:, 1 + WINDOW // 2] + before[:, 1])
        leaves, rest = _compared(now - before[:, 1], apart, bent)
        place = predicted[motor_place(model)]
        agrees = [ca.fabs(now[1 + i] - place - kalman[3 + n + i]) < near for i in range(2)]
        leaves = ca.logic_or(leaves, ca.logic_and(stands, _compared(now - begun, beside, ca.fabs(now - begun) / 2)[0]))
        unlikely = ca.logic_and(ca.fabs(expected - angle) > noticed, ca.logic_or(*agrees))
        leaves = ca.logic_or(leaves, ca.logic_and(stands, unlikely))
        helped = ca.logic_and(near > 0, ca.logic_or(finite(now[1]), finite(now[2])))
        history = ca.vec(ca.horzcat(begun, before[:, 2:], now))
    out = ca.logic_or(ca.logic_or(frozen, ca.logic_and(leaves, ca.logic_not(rest))), ca.logic_and(doubted, stands))
    held_back = ca.logic_and(out, stands)
    begins = ca.logic_and(held_back, ca.logic_not(ca.logic_or(doubted, helped)))
    parts = ca.if_else(begins, ca.vertcat(free_d, free), kalman[2 : 3 + n])
    memory = ca.vertcat(raw, same, pushed, out, ahead, free_d, history)
    outputs = [ca.vertcat(kalman[:2], parts, kalman[3 + n :]), angle, ca.densify(memory), out, rest]
    return ca.Function("watch", [kalman, readings, watched, acted, p, own], outputs, {"cse": True})


def _compared(moved: Any, apart: Any, soft: Any) -> tuple[Any, Any]:
    """Whether the load's encoder leaves the motors', and whether it is these that stand, from what each has moved (4,).

    A drivetrain that is softer than the model says lets a motor go ahead where it sets out; it may by `soft` (4,).
    """
    load, *motors, twist = ca.vertsplit(moved)
    heard = [finite(motor) for motor in motors]
    own = [motor - twist for motor in motors]
    gone = [ca.fabs(load - motor) > apart + soft[1 + i] for i, motor in enumerate(own)]
    agree = ca.logic_not(ca.logic_and(ca.logic_and(*heard), ca.fabs(motors[0] - motors[1]) > apart))
    all_gone = ca.logic_and(*(ca.logic_or(ca.logic_not(h), g) for h, g in zip(heard, gone, strict=True)))
    leaves = ca.logic_and(ca.logic_and(ca.logic_or(*heard), finite(load)), ca.logic_and(agree, all_gone))
    rest = ca.logic_and(*(ca.logic_or(ca.logic_not(h), motor == 0) for h, motor in zip(heard, motors, strict=True)))
    return leaves, ca.logic_and(leaves, ca.logic_and(rest, load != 0))
