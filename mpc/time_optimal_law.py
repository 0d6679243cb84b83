"""Equations of the reference governor, sample by sample: minimum-time motion with bounded acceleration."""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca

from mpc.slots import Tuning
from mpc.soft_limits import SOFT
from mpc.stage_allocation import MACHINE, reach

_USED = 0.85
"""Share of the reachable acceleration that the governed reference may use; the rest is left to feedback."""

_MARGIN = 0.75
"""Share of that acceleration, and of its mean in both directions, for braking before a limit: friction helps to brake,
but ends with the motion."""


_ANY = 1e30
"""Limit of `jerk` where it is infinite, because there is no contact to keep."""

_THERE = 1e-6
"""Distance at which a move has ended, in units of `Tuning.ATTAINABLE`."""

_JUMP = 8.0
"""Second difference of the reference from which it counts as a jump, in units of `Tuning.ATTAINABLE`: the torques need
several samples to follow it."""


def time_optimal_acceleration(error: Any, rate: Any, limits: tuple[Any, Any], step: Any) -> Any:
    """Acceleration that brings a double integrator to rest at zero in least time, in discrete time, as an expression.

    The control law of Han ("From PID to active disturbance rejection control", 2009, eq. 3), with one limit for each
    direction. Unlike the switching curve of continuous time it reaches zero exactly after finitely many steps, without
    chattering. The switching curve uses the limit of the braking direction.

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
    """Greatest speed from which the load can stop within a distance `room`, in discrete time [rad/s]."""
    braked = acceleration * (ca.sqrt(ca.fmax(dt**2 / 4, 2 * room / acceleration)) - dt / 2)
    return ca.fmax(braked, ca.fmin(room / dt, acceleration * dt))


def jerk_limited(distance: Any, jerk: Any) -> Any:
    """Acceleration of a move over a distance such that the torques can reverse in a quarter of its duration.

    The acceleration then reverses at a rate of four times `jerk` [rad/s^3].
    """
    return (ca.fmin(jerk, _ANY) * ca.sqrt(ca.fabs(distance))) ** (2 / 3)


@cache
def hurry() -> Any:
    """The acceleration of a move, as a `casadi.Function`.

    (governed angle, wanted angle, result of the sample before, `Tuning.ATTAINABLE`, `jerk` of `unhurried`) ->
    acceleration relative to the reference [rad/s^2]. During a move it keeps its largest value, that of the largest
    distance; it is zero without a move.
    """
    path, wanted, before = ca.SX.sym("path"), ca.SX.sym("wanted"), ca.SX.sym("before")
    attainable, jerk = ca.SX.sym("attainable"), ca.SX.sym("jerk")
    off, held = path - wanted, ca.if_else(before >= 0, before, 0)
    kept = ca.if_else(ca.fabs(off) > _THERE * attainable, held, 0)
    pull = ca.fmax(jerk_limited(off, jerk), kept)
    return ca.Function("hurry", [path, wanted, before, attainable, jerk], [pull], {"cse": True})


@cache
def governed(limited: bool = False) -> Any:
    """One sample of the governed reference, as a `casadi.Function`.

    (distance from the wanted angle and rate (2,), wanted angle, its changes in this sample and the next one (2,),
    greatest acceleration backward, forward, and relative to the reference (3,), soft limits (see
    `SoftLimits.numbers`), sample time) -> distance from the wanted angle and rate (2,) at the next sample. With
    `limited` it brakes before a limit, whatever the reference. Distances and changes are used because differences of
    angles, divided by the square of the sample time, lose all digits in single precision.
    """
    path, wanted, steps = ca.SX.sym("path", 2), ca.SX.sym("wanted"), ca.SX.sym("steps", 2)
    limits, soft, dt = ca.SX.sym("limits", 3), ca.SX.sym("soft", SOFT), ca.SX.sym("dt")
    (off, rate), (backward, forward, most) = ca.vertsplit(path), ca.vertsplit(limits)
    beyond: Any = ca.SX(3, 1)
    if limited:  # part of the wanted angle outside the limits
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
        least, greatest = (_MARGIN * ca.fmin(brake, (backward + forward) / 2) for brake in (forward, backward))
        up = ca.fmin(_fastest(soft[1] - next_angle, greatest, dt), soft[2])
        down = ca.fmin(_fastest(next_angle - soft[0], least, dt), soft[2])
        next_rate = ca.fmin(next_rate, ca.fmax(up, rate - dt * backward))
        next_rate = ca.fmax(next_rate, -ca.fmax(down, -rate - dt * forward))
    inputs = [path, wanted, steps, limits, soft, dt]
    return ca.Function("govern", inputs, [ca.vertcat(next_off, next_rate)], {"cse": True})


@cache
def jump() -> Any:
    """Whether the reference jumps to a sample, as a `casadi.Function`.

    (wanted angle around that sample (3,), `Tuning.ATTAINABLE`) -> whether it does.
    """
    wanted, attainable = ca.SX.sym("wanted", 3), ca.SX.sym("attainable")
    before, change = wanted[1] - wanted[0], wanted[2] - wanted[1]
    jumps = ca.logic_and(ca.fabs(before - change) > _JUMP * attainable, ca.fabs(change) < ca.fabs(before))
    return ca.Function("jump", [wanted, attainable], [jumps])


@cache
def early() -> Any:
    """Whether the move to a previewed jump of the reference has to start, as a `casadi.Function`.

    (angle and rate (2,), wanted angle around the sample of the jump (3,), number of samples until then, greatest
    acceleration backward and forward (2,), sample time, `jerk` of `unhurried`) -> whether to start, and the change of
    the wanted angle per sample after the jump.

    The squared error is least if the jump is in the middle of the move. So the move starts when the time until the
    jump is at most half of the shortest duration of the move; a move that has started continues.
    """
    path, wanted, limits = ca.SX.sym("path", 2), ca.SX.sym("wanted", 3), ca.SX.sym("limits", 2)
    count, dt, jerk, change = ca.SX.sym("count"), ca.SX.sym("dt"), ca.SX.sym("jerk"), wanted[2] - wanted[1]
    error, rate = path[0] - (wanted[1] - count * change), path[1] - change / dt
    a = ca.fmin(ca.fmin(limits[0], limits[1]), jerk_limited(error, jerk))
    direction = ca.sign(error + rate * ca.fabs(rate) / (2 * a))
    least = direction * rate / a + 2 * ca.sqrt(ca.fmax(rate**2 / (2 * a**2) + direction * error / a, 0))
    due = count * dt <= least / ca.if_else(direction * rate < 0, 1, 2)
    return ca.Function("early", [path, wanted, count, limits, dt, jerk], [due, change], {"cse": True})


@cache
def followable() -> Any:
    """Acceleration limits of the governed reference, as a `casadi.Function`.

    (angle and velocity of the load, its torque without acceleration, machine, tuning) -> greatest acceleration backward
    and forward (2,) [rad/s^2], and the distance to the load [rad] above which the governed reference restarts.
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
