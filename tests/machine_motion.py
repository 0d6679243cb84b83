"""How a machine that hides effects moves: fine Runge-Kutta steps, with dry friction located in time.

A load that stops inside a step stops exactly there, and holds or breaks away. Rate limit and lag of the actuator and
the lag of the sensor are followed in closed form.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from machine_laws import Array, Machine
from numpy.typing import ArrayLike, NDArray

_PIECES = 8  # of a step's way, before the lag of a sensor


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class State:
    """Where a batch stands."""

    motion: Array  # (2, B) angle and velocity of the load; behind a drivetrain (4, B), those of the motor after them
    slewed: Array  # (B,) command behind the rate limit [N m], of a position servo the goal [rad]
    lagged: Array  # (B,) and behind the lag [N m]
    bristle: Array  # (B,) friction torque of bent bristles [N m]
    seen: Array  # (B,) reading behind the lag of the sensor [rad]

    @staticmethod
    def settled(machine: Machine, x: Array, v: Array, command: Array) -> State:
        """At rest in all but its motion."""
        motion = np.stack((x, v, x, v) if machine.drivetrain else (x, v))
        zero = np.zeros_like(x)
        return State(motion=motion, slewed=command, lagged=command, bristle=zero, seen=machine.reading(x))


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class _Step:
    """What holds all through one step: the torque (a servo's goal) at its start, middle, end, and where it begins."""

    machine: Machine
    torque: Sequence[Array]
    load_torque: Array
    bristle: Array
    time: Array
    length: Array

    def pick(self, rows: NDArray[np.bool_]) -> _Step:
        return _Step(
            machine=self.machine.pick(rows, rows.size),
            torque=[torque[rows] for torque in self.torque],
            load_torque=self.load_torque[rows],
            bristle=self.bristle[rows],
            time=self.time[rows],
            length=self.length[rows],
        )


def advance(machine: Machine, state: State, command: Array, load_torque: Array, time: Array, h: Array) -> State:
    """One fine step under a constant command, taken in parts where the laws have a kink inside it."""
    kinks, ends = [], [h]
    if change := machine.effects.get("payload_change"):
        kinks.append(change["time"] - time)
    if limit := _limit(machine):
        kinks.append(np.abs(command - state.slewed) / limit["rate"])
        if not machine.is_servo and "actuator_lag" not in machine.effects:
            kinks += [_passing(state.slewed, command, corner, limit["rate"]) for corner in machine.corners]
    elif lag := machine.effects.get("actuator_lag"):
        kinks += [_fading(state.lagged, command, corner, lag["time_constant"]) for corner in machine.corners]
    if stop := machine.effects.get("end_stop"):
        x, v = state.motion[0], state.motion[1]
        kinks.append((stop["angle"] - x) / np.where(v == 0.0, 1.0, v))
    if not kinks:
        return _advance(machine, state, command, load_torque, time, h)
    if any(np.any((kink > 0.0) & (kink < h)) for kink in kinks):
        ends = [*np.sort(np.clip(kinks, 0.0, h), axis=0), h]
    begin = np.zeros_like(h)
    for end in ends:
        if change:
            machine = machine.carrying(time + (begin + end) / 2 > change["time"])
        state = _advance(machine, state, command, load_torque, time + begin, end - begin)
        begin = end
    return state


def _advance(machine: Machine, state: State, command: Array, load_torque: Array, time: Array, h: Array) -> State:
    start, torque, slewed, lagged = state.motion, *_actuator(machine, state, command, h)
    step = _Step(machine=machine, torque=torque, load_torque=load_torque, bristle=state.bristle, time=time, length=h)
    if machine.slides:
        motion, bristle = _slide(step, start)
    else:
        motion, bristle = _runge_kutta(step, start, None), state.bristle
    seen = _sensor(machine, state.seen, start, motion, h)
    return State(motion=motion, slewed=slewed, lagged=lagged, bristle=bristle, seen=seen)


# Actuator and sensor, in closed form.


def _limit(machine: Machine) -> Mapping[str, ArrayLike] | None:
    """The rate limit of a torque, or of a position servo's goal."""
    return machine.effects.get("setpoint_rate_limit" if machine.is_servo else "rate_limit")


def _actuator(machine: Machine, state: State, command: Array, h: Array) -> tuple[list[Array], Array, Array]:
    """Amplified torque, or a goal, at the start, middle and end of a step; the new states of rate limit and lag."""
    ramp, lag = _limit(machine), machine.effects.get("actuator_lag")
    amplified = (lambda goal: goal) if machine.is_servo else machine.amplified
    if not ramp and not lag:
        return [amplified(command)] * 3, command, command
    if not lag:
        start, middle, end = state.slewed, *(_ramp(state.slewed, command, ramp["rate"], t) for t in (h / 2, h))
        slewed = end
    elif not ramp:
        # A lag may be over long before the step is: its start counts for as much as makes the step's impulse exact.
        steps = np.maximum(h / lag["time_constant"], 1e-9)
        middle, end = np.exp(-steps / 2.0), np.exp(-steps)
        start = -6.0 * np.expm1(-steps) / steps - 4.0 * middle - end
        start, middle, end = (command + (state.lagged - command) * share for share in (start, middle, end))
        slewed = command
    else:
        slope = (state.slewed, command, ramp["rate"])
        behind = (_lag_of_ramp(state.lagged, *slope, lag["time_constant"], t) for t in (h / 2, h))
        start, middle, end = state.lagged, *behind
        slewed = _ramp(*slope, h)
    return [amplified(torque) for torque in (start, middle, end)], slewed, end


def _fading(start: Array, goal: Array, to: Array, time_constant: ArrayLike) -> Array:
    """When a lagged torque on its way to a goal passes a value, -1 where it never does."""
    away, left = start - goal, to - goal
    passes = (away * left > 0.0) & (np.abs(away) > np.abs(left))
    return np.where(passes, time_constant * np.log(np.where(passes, away, 1.0) / np.where(passes, left, 1.0)), -1.0)


def _passing(start: Array, goal: Array, to: Array, rate: ArrayLike) -> Array:
    """When a ramp towards a goal passes a value, -1 where it never does."""
    passes = (to - start) * (goal - to) > 0.0
    return np.where(passes, np.abs(to - start) / rate, -1.0)


def _ramp(start: Array, goal: Array, rate: ArrayLike, t: Array) -> Array:
    """On the way to a goal at a limited rate, a time t after the start."""
    missing = goal - start
    return np.where(np.abs(missing) > rate * t, start + np.sign(missing) * rate * t, goal)


def _lag_of_ramp(lagged: Array, start: Array, goal: Array, rate: ArrayLike, time_constant: Array, t: Array) -> Array:
    """The same behind a first-order lag, which lies a constant torque behind the ramp once its start has faded."""
    missing = goal - start
    arrival = np.minimum(np.abs(missing) / rate, t)
    behind = np.sign(missing) * rate * time_constant
    faded = (lagged - start + behind) * np.exp(-arrival / time_constant)
    at_arrival = start + np.sign(missing) * rate * arrival - behind + faded
    return np.asarray(goal + (at_arrival - goal) * np.exp(-(t - arrival) / time_constant))


def _sensor(machine: Machine, seen: Array, start: Array, end: Array, h: Array) -> Array:
    """The reading behind the sensor's lag: the way through a step is cut into pieces that are taken as straight."""
    if not (p := machine.effects.get("sensor_lag")):
        return machine.reading(end[0])
    (x, v), (new_x, new_v), place = start[:2], end[:2], np.linspace(0.0, 1.0, _PIECES + 1)[:, None]
    curvature = place * (1.0 - place) * ((1.0 - place) * (v * h - new_x + x) - place * (new_v * h - new_x + x))
    way = machine.reading(x + place * (new_x - x) + curvature)  # cubic, with the speeds at both ends (Hermite)
    steps = np.where(h > 0.0, p["time_constant"] / np.where(h > 0.0, h, 1.0), 0.0) * _PIECES
    fade = np.exp(-h / _PIECES / p["time_constant"])
    for old, new in pairwise(way):
        behind = (new - old) * steps
        seen = new - behind + (seen - old + behind) * fade
    return np.asarray(seen)


# Motion.


def _slide(step: _Step, start: Array) -> tuple[Array, Array]:
    """A step with dry friction: motion and bent bristles at its end."""
    way = _way(step, start)
    motion = _runge_kutta(step, start, way)
    bristle = step.machine.bristle(step.bristle, motion[0] - start[0], way)
    turns = motion[1] * way < 0
    if turns.any():
        motion[:, turns], after = _through_rest(step.pick(turns), start[:, turns], motion[1, turns], way[turns])
        bristle = bristle.copy()
        bristle[turns] = after
    return motion, bristle


def _way(step: _Step, motion: Array) -> Array:
    """Direction of sliding: of the velocity, at rest of a pull above breakaway, zero when the load is held."""
    x, v = motion[0], motion[1]
    way = np.sign(v)
    if way.all():
        return way
    rest = np.zeros_like(v)
    arriving = _arriving(step, motion, step.torque[0])
    pull = step.machine.pull(x, rest, arriving + step.load_torque, step.time) - step.bristle
    lean = np.sign(pull)
    breaks = np.abs(pull) > step.machine.dry(rest, lean, arriving, step.time)
    return np.where(v != 0.0, way, np.where(breaks, lean, 0.0))


def _through_rest(step: _Step, start: Array, beyond: Array, way: Array) -> tuple[Array, Array]:
    """A step in which the load comes to rest: up to the instant of rest, then held or away again."""
    machine, h, v = step.machine, step.length, start[1]
    least, most = np.zeros_like(h), np.ones_like(h)
    share = np.clip(v / np.where(v == beyond, 1.0, v - beyond), 0.0, 1.0)
    for _ in range(30):  # regula falsi with bisection as its guard
        rest = _runge_kutta(replace(step, length=share * h), start, way)
        still = rest[1] * way > 0
        least, most = np.where(still, share, least), np.where(still, most, share)
        if np.all(np.abs(rest[1]) < 1e-13):
            break
        slope = (rest[1] - v) / np.where(share > 0, share, 1.0)
        guess = share - rest[1] / np.where(slope == 0.0, -1.0, slope)
        share = np.where((guess > least) & (guess < most), guess, (least + most) / 2)
    rest[1] = 0.0
    left = replace(
        step,
        torque=[step.torque[2]] * 3,
        bristle=machine.bristle(step.bristle, rest[0] - start[0], way),
        time=step.time + share * h,
        length=(1.0 - share) * h,
    )
    again = _way(left, rest)
    motion = _runge_kutta(left, rest, again)
    back = motion[1] * again < 0
    if back.any():  # a pull at the edge of breakaway: hold for the remainder
        again = np.where(back, 0.0, again)
        motion = _runge_kutta(left, rest, again)
    return motion, machine.bristle(left.bristle, motion[0] - rest[0], again)


def _runge_kutta(step: _Step, start: Array, way: Array | None) -> Array:
    """Classical fourth-order step with friction of one direction; a load whose direction is zero is held."""
    h, half, (first, middle, last) = step.length, step.length / 2, step.torque
    held = None if way is None or way.all() else way == 0.0
    early, late = step.time + half, step.time + h

    def rates(motion: Array, torque: Array, time: Array) -> Array:
        return _rates(step, start[0], motion, torque, time, way, held)

    k1 = rates(start, first, step.time)
    k2 = rates(start + half * k1, middle, early)
    k3 = rates(start + half * k2, middle, early)
    k4 = rates(start + h * k3, last, late)
    return np.asarray(start + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))


def _rates(
    step: _Step, origin: Array, motion: Array, torque: Array, time: Array, way: Array | None, held: Array | None
) -> Array:
    """Rates of change of the motion under an amplified torque; at `origin` the bristles are as the step has them."""
    machine, x, v = step.machine, motion[0], motion[1]
    rates = np.empty(motion.shape)
    arriving = _arriving(step, motion, torque)
    total = machine.pull(x, v, arriving + step.load_torque, time)
    if way is not None:
        total = total - way * machine.dry(v, way, arriving, time)
        if "presliding_hysteresis" in machine.effects:
            total = total - machine.bristle(step.bristle, x - origin, way)
    if held is not None:
        total = np.where(held, 0.0, total)
    rates[0], rates[1] = v, total / machine.load_inertia
    if machine.drivetrain:
        driving = machine.biased(machine.delivered(torque, x, v))
        rates[2], rates[3] = motion[3], (driving - arriving) / machine.drivetrain.motor_inertia
    return rates


def _arriving(step: _Step, motion: Array, torque: Array) -> Array:
    """Torque that reaches the load: from the actuator, or through the drivetrain."""
    if drivetrain := step.machine.drivetrain:
        return drivetrain.transmitted(motion[2] - motion[0], motion[3] - motion[1])
    return step.machine.delivered(torque, motion[0], motion[1])
