"""How the reference governor moves, one sample at a time: in least time under a bounded acceleration."""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca

from mpc.corridor import SOFT
from mpc.slots import Tuning
from mpc.split import MACHINE, reach

_USED = 0.85
"""Share of the reachable acceleration that the governed reference may ask for; the rest is left to feedback."""

_SURE = 0.75
"""Share of that acceleration, and of its mean in both senses, with which it brakes before a limit: friction helps to
brake, but ends with the motion."""


_ANY = 1e30
"""Of a change of the acceleration: any, where nothing has to be kept together."""

_THERE = 1e-6
"""Distance at which a move is over, in units of what the torques attain in a sample."""

_JUMP = 8.0
"""Change of the reference's speed that is a jump, in units of what the torques attain in a sample: to follow it takes
several samples."""


def time_optimal_acceleration(error: Any, rate: Any, limits: tuple[Any, Any], step: Any) -> Any:
    """Acceleration that brings a double integrator to rest at zero in least time, in discrete time, as an expression.

    The control law of Han ("From PID to active disturbance rejection control", 2009, eq. 3), with one limit for each
    sense: unlike the switching curve of continuous time it ends exactly at zero after finitely many steps and does not
    chatter there. The curve is that of the sense which brakes.

    Args:
        error, rate: position and its rate [rad], [rad/s].
        limits: greatest acceleration backward and forward [rad/s^2], both above zero.
        step: time step [s].
    """
    backward, forward = limits
    a0 = step * rate
    y = error + a0
    d = ca.if_else(y > 0, forward, backward) * step**2
    a1 = ca.sqrt(d * (d + 8.0 * ca.fabs(y)))
    a = a0 + ca.if_else(ca.fabs(y) <= d, y, ca.copysign((a1 - d) / 2.0, y))
    return ca.fmax(ca.fmin(-a / step**2, forward), -backward)


def _fastest(room: Any, acceleration: Any, dt: Any) -> Any:
    """Greatest speed from which it can still be stopped within some room, in discrete time [rad/s]."""
    braked = acceleration * (ca.sqrt(ca.fmax(dt**2 / 4, 2 * room / acceleration)) - dt / 2)
    return ca.fmax(braked, ca.fmin(room / dt, acceleration * dt))


def unhurried(distance: Any, jerk: Any) -> Any:
    """Acceleration at which a move over a distance takes so long that the torques can change in a quarter of it.

    From full acceleration to full braking, with a greatest rate of change [rad/s^3] of four times `jerk`.
    """
    return (ca.fmin(jerk, _ANY) * ca.sqrt(ca.fabs(distance))) ** (2 / 3)


@cache
def hurry() -> Any:
    """How fast a move is made, as a `casadi.Function`.

    (governed and wanted angle, the same function's answer one sample before, attainable change, `jerk` of `unhurried`)
    -> acceleration beside that of the reference [rad/s^2]; as of the farthest sample of the move, zero without one.
    """
    path, wanted, before = ca.SX.sym("path"), ca.SX.sym("wanted"), ca.SX.sym("before")
    attainable, jerk = ca.SX.sym("attainable"), ca.SX.sym("jerk")
    off, held = path - wanted, ca.if_else(before >= 0, before, 0)
    kept = ca.if_else(ca.fabs(off) > _THERE * attainable, held, 0)
    pull = ca.fmax(unhurried(off, jerk), kept)
    return ca.Function("hurry", [path, wanted, before, attainable, jerk], [pull], {"cse": True})


@cache
def governed(limited: bool = False) -> Any:
    """One sample of the governed reference, as a `casadi.Function`.

    (distance from the wanted angle and rate (2,), wanted angle, its changes in this sample and the next one (2,),
    greatest acceleration backward and forward, and beside that of the reference (3,), soft limits (see
    `SoftLimits.numbers`), sample time) -> distance from the wanted angle and rate (2,) at the next sample. If it is
    limited it brakes before a limit, whatever is wanted. Distances and changes, because differences of angles have no
    digits left in single precision when they are divided by the square of the sample time.
    """
    path, wanted, steps = ca.SX.sym("path", 2), ca.SX.sym("wanted"), ca.SX.sym("steps", 2)
    limits, soft, dt = ca.SX.sym("limits", 3), ca.SX.sym("soft", SOFT), ca.SX.sym("dt")
    (off, rate), (backward, forward, most) = ca.vertsplit(path), ca.vertsplit(limits)
    beyond: Any = ca.SX(3, 1)
    if limited:  # what of the wanted angle is not asked for
        there = wanted + ca.vertcat(0, steps[0], steps[0] + steps[1])
        beyond = there - ca.fmin(ca.fmax(there, soft[0]), soft[1])
    speed = (steps[0] - (beyond[1] - beyond[0])) / dt
    turn = ((steps[1] - (beyond[2] - beyond[1])) / dt - speed) / dt
    own = ca.fmin(ca.fmax(turn, -backward), forward)
    least = 0.2 * ca.fmin(forward, backward)
    room = [ca.fmin(ca.fmax(left, least), most) for left in (backward + own, forward - own)]
    pull = time_optimal_acceleration(off + beyond[0], rate - speed, (room[0], room[1]), dt)
    next_off, next_rate = off + (dt * rate - steps[0]), rate + dt * ca.fmin(ca.fmax(own + pull, -backward), forward)
    if limited:
        next_angle = wanted + off + dt * rate
        least, greatest = (_SURE * ca.fmin(brake, (backward + forward) / 2) for brake in (forward, backward))
        up = ca.fmin(_fastest(soft[1] - next_angle, greatest, dt), soft[2])
        down = ca.fmin(_fastest(next_angle - soft[0], least, dt), soft[2])
        next_rate = ca.fmin(next_rate, ca.fmax(up, rate - dt * backward))
        next_rate = ca.fmax(next_rate, -ca.fmax(down, -rate - dt * forward))
    inputs = [path, wanted, steps, limits, soft, dt]
    return ca.Function("govern", inputs, [ca.vertcat(next_off, next_rate)], {"cse": True})


@cache
def jump() -> Any:
    """Whether the reference jumps to a sample, as a `casadi.Function`.

    (wanted angle around that sample (3,), attainable change) -> whether it does.
    """
    wanted, attainable = ca.SX.sym("wanted", 3), ca.SX.sym("attainable")
    before, change = wanted[1] - wanted[0], wanted[2] - wanted[1]
    jumps = ca.logic_and(ca.fabs(before - change) > _JUMP * attainable, ca.fabs(change) < ca.fabs(before))
    return ca.Function("jump", [wanted, attainable], [jumps])


@cache
def early() -> Any:
    """Whether it is time to set out for a jump of the reference that is seen ahead, as a `casadi.Function`.

    (angle and rate (2,), wanted angle around that sample (3,), how many samples ahead it is, greatest acceleration
    backward and forward (2,), sample time, `jerk` of `unhurried`) -> whether it is time, and the change of the wanted
    angle from there on, in a sample.

    A jump is followed with least squared error by a move that has its middle where the jump is: so it is time if the
    sample is no farther ahead than half of the least time to it takes, and a move that is under way goes on.
    """
    path, wanted, limits = ca.SX.sym("path", 2), ca.SX.sym("wanted", 3), ca.SX.sym("limits", 2)
    count, dt, jerk, change = ca.SX.sym("count"), ca.SX.sym("dt"), ca.SX.sym("jerk"), wanted[2] - wanted[1]
    error, rate = path[0] - (wanted[1] - count * change), path[1] - change / dt
    a = ca.fmin(ca.fmin(limits[0], limits[1]), unhurried(error, jerk))
    sense = ca.sign(error + rate * ca.fabs(rate) / (2 * a))
    least = sense * rate / a + 2 * ca.sqrt(ca.fmax(rate**2 / (2 * a**2) + sense * error / a, 0))
    due = count * dt <= least / ca.if_else(sense * rate < 0, 1, 2)
    return ca.Function("early", [path, wanted, count, limits, dt, jerk], [due, change], {"cse": True})


@cache
def followable() -> Any:
    """What the torques can follow, as a `casadi.Function`.

    (angle and velocity of the load, torque that it takes without accelerating, machine, tuning) -> greatest
    acceleration backward and forward (2,) [rad/s^2], and from how far off [rad] the governed reference begins anew.
    """
    state, load = ca.SX.sym("state", 2), ca.SX.sym("load")
    numbers, tuning = ca.SX.sym("machine", MACHINE), ca.SX.sym("tuning", len(Tuning))
    inertia, greatest, wave = tuning[Tuning.INERTIA], tuning[Tuning.GREATEST], tuning[Tuning.WAVE]
    ends = reach()(state[1], 0.0, numbers)
    floor = 0.1 * greatest
    backward = ca.fmax(_USED * (load - ends[0]), floor) / inertia
    forward = ca.fmax(_USED * (ends[1] - load), floor) / inertia
    near = 10 * ((backward + forward) / 2 / wave**2)
    return ca.Function("followable", [state, load, numbers, tuning], [ca.vertcat(backward, forward), near])
