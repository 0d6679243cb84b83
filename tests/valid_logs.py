"""Right logs of many kinds of machines, drawn: what must pass the door, and with one sign or unit wrong must not.

NumPy alone, all machines at once. Each has an inertia, viscous and dry friction, gravity, and by chance cogging, a soft
shaft, a load that fluctuates, a delay, a lag, noise and a coarse encoder; it is driven in the open, by a loop that
tracks, a loop that holds, a lift, or it is a generator that a prime mover turns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
KINDS = ("noise", "binary", "staircase", "track", "moves", "sine", "speed", "lift", "hold", "generator")
SAMPLES, FINE = 3000, 8


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawn:
    """Logs of B machines: kind (B,), sample time (B,) [s], (T, B) torque [N m] and angle [rad], (T, B, 2) torques.

    The two torques of one gear train with `ratio` (B,) make `torque` where `pair` (B,) is True.
    """

    kind: NDArray[np.str_]
    sample_time: Array
    torque: Array
    angle: Array
    torques: Array
    ratio: Array
    pair: NDArray[np.bool_]

    def columns(self, place: int, *, sign: tuple[float, float] = (1.0, 1.0), turn: float = 1.0) -> dict[str, Array]:
        """Channels of one log, its torques times `sign` and its angle times `turn`."""
        log = {"time": self.sample_time[place] * np.arange(SAMPLES), "angle": turn * self.angle[:, place]}
        if self.pair[place]:
            return log | {f"torque_{k + 1}": sign[k] * self.torques[:, place, k] for k in (0, 1)}
        return log | {"torque": sign[0] * self.torque[:, place]}


@dataclass(frozen=True)
class Ratio:
    """Two motors on one gear, both with one ratio."""

    ratio: float

    @property
    def torque_map(self) -> Array:
        """(2,) torque on the load per torque of each motor."""
        return np.array([self.ratio, self.ratio])


def draw(count: int, seed: int) -> Drawn:
    """`count` logs of as many machines."""
    rng = np.random.default_rng(seed)

    def log(low: float, high: float) -> Array:
        return np.exp(rng.uniform(np.log(low), np.log(high), count))

    def some(share: float, values: Array) -> Array:
        return np.where(rng.random(count) < share, values, 0.0)

    kind = rng.permutation(np.resize(np.array(KINDS), count))
    dt = log(5e-4, 0.02)
    delay = rng.integers(0, 4, count)
    lag = some(0.4, dt * log(0.3, 4.0))
    pace = 2 * np.pi / (SAMPLES * dt) * log(8.0, 60.0)  # [rad/s] of the reference
    loop = np.minimum(pace * log(2.0, 8.0), 0.3 / ((delay + 2) * dt + lag))
    size, inertia = log(0.05, 30.0), log(1e-5, 10.0)
    push = inertia * size * pace**2  # torque that moves the load by its size at its pace
    viscous = inertia * pace * log(0.02, 5.0)
    dry = some(0.7, push * log(0.05, 5.0))
    gravity = some(0.5, push * log(0.1, 5.0))
    cogging, teeth = some(0.3, push * log(0.02, 0.3)), rng.integers(3, 40, count)
    weight = np.where(kind == "lift", push * log(2.0, 10.0), some(0.3, push * rng.uniform(-0.3, 0.3, count)))
    flows = np.isin(kind, ("generator", "hold"))
    flow = np.where(flows, push * log(1.0, 3.0), some(0.4, push * log(0.02, 0.3)))
    shaft = np.where(
        (rng.random(count) < 0.15) & ~np.isin(kind, ("speed", "generator")), loop * log(8.0, 30.0), 0.0
    )  # [rad/s], 0 for a stiff one
    load = _wandering(rng, count) * flow
    load = np.where(kind == "generator", np.abs(load) + flow, load)
    wanted = _reference(rng, kind, count, size, pace * dt)
    opened = np.isin(kind, ("noise", "binary", "staircase"))
    forward = np.where(opened, wanted / size * (push + 1.3 * dry + gravity) + weight, 0.0)
    stiffness = np.where(np.isin(kind, ("speed", "generator")), 0.0, inertia * loop**2)
    damping = np.where(kind == "generator", inertia * pace * log(0.5, 3.0), 1.6 * inertia * loop)
    step = np.where(rng.random(count) < 0.8, size / log(30.0, 3e4), 0.0)
    noise = step * rng.uniform(0.0, 2.0, count)
    offset = rng.uniform(-np.pi, np.pi, count)

    motor, speed = np.zeros(count), np.zeros(count)
    angle, velocity = motor.copy(), speed.copy()
    acting, reading, seen = np.zeros(count), np.zeros(count), np.zeros(count)
    sent = np.zeros((SAMPLES + 4, count))
    measured, torque = np.zeros((SAMPLES, count)), np.zeros((SAMPLES, count))
    share = np.where(shaft > 0, 0.4, 1.0)  # of the inertia at the motor
    soft, h, rows = shaft > 0, dt / FINE, np.arange(count)
    stiff = shaft**2 * inertia * share * (1 - share)
    rises = np.where(np.isin(kind, ("speed", "generator")), wanted, np.gradient(wanted, axis=0)) / dt
    rises = np.where(np.isin(kind, ("moves", "hold", "lift")), 0.0, rises)
    for k in range(SAMPLES):
        fresh = angle + noise * rng.standard_normal(count)
        fresh = np.where(step > 0, step * np.round(fresh / np.where(step > 0, step, 1.0)), fresh)
        reading, seen = fresh, seen + 0.4 * ((fresh - reading) / dt - seen)
        answer = stiffness * (wanted[k] - reading) + damping * (rises[k] - seen)
        sent[k] = np.where(opened, forward[k], answer + np.where(kind == "lift", weight, 0.0))
        target = sent[np.maximum(k - delay, 0), rows]
        measured[k] = reading
        torque[k] = acting if k else target
        for _ in range(FINE):
            acting = np.where(
                lag > 0, acting + (1 - np.exp(-h / np.where(lag > 0, lag, 1.0))) * (target - acting), target
            )
            held = gravity * np.cos(angle + offset) + cogging * np.sin(teeth * angle) + weight
            twist = np.where(
                soft, stiff * (motor - angle) + 0.2 * stiff / np.where(soft, shaft, 1.0) * (speed - velocity), 0
            )
            velocity = _rub(
                velocity,
                np.where(soft, twist, acting) + load[k] - held - viscous * velocity,
                dry,
                inertia * np.where(soft, 1 - share, 1.0),
                h,
            )
            speed = np.where(soft, speed + h * (acting - twist) / (inertia * share), velocity)
            angle = angle + h * velocity
            motor = np.where(soft, motor + h * speed, angle)
    measures = rng.random(count) < 0.4  # the torque is a reading, not a command
    measured_torque = np.where(measures, torque, sent[:SAMPLES])
    measured_torque = measured_torque + some(0.5, log(0.003, 0.1)) * measured_torque.std(axis=0) * rng.standard_normal(
        measured_torque.shape
    )
    ratio = log(1.0, 20.0)
    pair, part, opposed = rng.random(count) < 0.2, rng.uniform(0.3, 0.7, count), rng.random(count) < 0.5
    preload = log(0.05, 2.0) * measured_torque.std(axis=0) * (1 + 0.1 * _wandering(rng, count))
    first = (
        np.where(opposed, np.maximum(measured_torque, 0.0), part * measured_torque) + preload
    )  # each on its own flank, or both on both
    torques = np.stack([first, measured_torque - first], axis=2) / ratio[:, None]
    torques += 0.01 * measured_torque.std(axis=0)[:, None] / ratio[:, None] * rng.standard_normal(torques.shape)
    return Drawn(
        kind=kind,
        sample_time=dt,
        torque=measured_torque,
        angle=measured + offset,
        torques=torques,
        ratio=ratio,
        pair=pair,
    )


def _rub(velocity: Array, force: Array, dry: Array, inertia: Array, step: Array) -> Array:
    """Velocity after a step in which dry friction takes what it can and never turns the load back."""
    free = velocity + step * force / inertia
    return np.asarray(np.sign(free) * np.maximum(np.abs(free) - step * dry / inertia, 0.0))


def _wandering(rng: np.random.Generator, count: int) -> Array:
    """(T, B) of unit size: filtered noise, from some to many times in a log."""
    rate = np.exp(rng.uniform(np.log(20.0), np.log(300.0), count)) / SAMPLES
    values, path = np.zeros(count), np.empty((SAMPLES, count))
    for k in range(SAMPLES):
        values = values + rate * (-values) + np.sqrt(2 * rate) * rng.standard_normal(count)
        path[k] = values
    return path


def _reference(rng: np.random.Generator, kind: NDArray[np.str_], count: int, size: Array, pace: Array) -> Array:
    """(T, B) what each loop is to follow, or what is sent in the open, of the machine's size; pace in rad a sample."""
    place = np.arange(SAMPLES)[:, None]
    waves = sum(np.sin(f * pace * place + rng.uniform(0, 7, count)) for f in (0.37, 0.71, 1.0, 1.63))
    hold = np.maximum((np.pi / pace).astype(int), 3)
    levels = rng.uniform(-1, 1, (SAMPLES, count))
    steps = np.take_along_axis(levels, place // hold, axis=0)
    binary = np.take_along_axis(np.sign(levels), place // np.maximum(hold // 3, 1), axis=0)
    # from rest to rest by a polynomial
    part = np.clip((place % hold) / hold * 1.5, 0, 1)
    before = np.take_along_axis(levels, np.maximum(place // hold - 1, 0), axis=0)
    moves = before + (steps - before) * part**3 * (10 - 15 * part + 6 * part**2)
    sine = np.sin(pace * place) * np.ones(count)
    speed = steps * pace  # staircase of speeds; over dt it is per second
    shapes = {"noise": 0.5 * waves, "binary": binary, "staircase": steps, "track": 0.5 * waves, "moves": moves}
    shapes |= {"sine": sine, "speed": speed, "lift": moves, "hold": 0 * sine, "generator": np.abs(steps) * pace}
    return np.asarray(size * np.stack([shapes[name][:, k] for k, name in enumerate(kind)], axis=1))
