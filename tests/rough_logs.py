"""Rough logs, drawn from a seed: any scale, any command, and what people's logs suffer from.

The machine is one inertia with gravity, viscous and dry friction, stepped in plain NumPy; nothing of the product is in
it, and it calibrates nothing. What its logs ask is whether a fit and a diagnosis end in a result or in one sentence.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.log import Log

Array = NDArray[np.float64]

KINDS = ("prbs", "staircase", "moves", "stick_slip", "standstill", "tones")
FINE = 4  # steps in a sample
SHORTEST = 0.21  # of a log: shorter ones are refused [s]


@dataclass(frozen=True, kw_only=True)
class RoughLog:
    """A log as it was drawn, with what it was drawn from; rotary in rad and N m, linear in m and N."""

    seed: int
    kind: str
    axis: str
    inertia: float
    level: float
    rate: float
    time: Array
    torque: Array
    angle: Array
    spoilt: tuple[str, ...]

    def __str__(self) -> str:
        """In one line."""
        return (
            f"{self.seed}: {self.kind}, {self.axis}, J {self.inertia:.1e}, torque {self.level:.1e}, "
            f"{self.time.size} samples at {self.rate:.0f} Hz{''.join(f', {how}' for how in self.spoilt)}"
        )

    def log(self) -> Log:
        """As a user's script would hand it over."""
        if self.axis == "linear":
            return Log.from_arrays(time=self.time, force=self.torque, position=self.angle)
        return Log.from_arrays(time=self.time, torque=self.torque, angle=self.angle)


@dataclass(frozen=True, kw_only=True)
class _Load:
    """Parameters of the machine, and the step of it."""

    inertia: float
    gravity: float
    viscous: float
    coulomb: float
    breakaway: float

    def step(self, angle: float, velocity: float, torque: float, h: float) -> tuple[float, float]:
        """Angle and velocity after h: friction of either kind by an implicit step."""
        held = self.breakaway if velocity == 0.0 else self.coulomb
        free = self.inertia * velocity + h * (torque - self.gravity * np.cos(angle))
        left = 0.0 if abs(free) <= h * held else free - h * self.coulomb * np.sign(free)
        after = left / (self.inertia + h * self.viscous)
        return angle + h * after, after


def rough_log(seed: int, *, longest: int = 50_000) -> RoughLog:
    """The log of a seed, of at most so many samples."""
    rng = np.random.default_rng(seed)
    kind, axis = KINDS[seed % len(KINDS)], "linear" if rng.random() < 0.3 else "rotary"
    rate = _log_uniform(rng, 10.0, min(20_000.0, longest / SHORTEST))
    samples = int(_log_uniform(rng, max(50.0, SHORTEST * rate), longest))
    inertia, level, speed, settling = _scales(rng, rate, samples)
    friction = level * (rng.uniform(0.3, 0.6) if kind in ("stick_slip", "standstill") else rng.uniform(0.0, 0.2))
    load = _Load(
        inertia=inertia,
        gravity=0.0 if axis == "linear" else level * rng.choice([0.0, rng.uniform(-0.3, 0.3)]),
        viscous=level / speed,
        coulomb=friction,
        breakaway=friction * (rng.uniform(1.2, 2.0) if kind == "stick_slip" else 1.0),
    )
    limit = level * (rng.uniform(0.3, 0.7) if (saturated := rng.random() < 0.2) else 1.0)
    unmodelled = rng.random() < 0.3
    time, torque, angle = _record(rng, kind, load, level, limit, speed, settling, rate, samples, 0.03 * unmodelled)
    span = float(np.ptp(angle)) or speed / rate
    reading = angle + span * _log_uniform(rng, 1e-6, 1e-2) * rng.standard_normal(samples)
    if counted := rng.random() < 0.25:
        reading = np.round(reading / (span / 256.0)) * (span / 256.0)
    spoilt = {"saturated": saturated, "3 % unmodelled": unmodelled, "8 bit": counted}
    return RoughLog(
        seed=seed,
        kind=kind,
        axis=axis,
        inertia=inertia,
        level=level,
        rate=rate,
        time=time,
        torque=torque,
        angle=reading,
        spoilt=tuple(how for how, is_so in spoilt.items() if is_so),
    )


def _scales(rng: np.random.Generator, rate: float, samples: int) -> tuple[float, float, float, float]:
    """Inertia, torque, greatest speed, and the time to reach it: half a sample to ten logs, torque 1e-3 to 1e3."""
    while True:
        inertia, speed = _log_uniform(rng, 1e-6, 1e2), _log_uniform(rng, 0.1, 1e3)
        settling = _log_uniform(rng, 0.5, 10.0 * samples) / rate
        level = inertia * speed / settling
        if 1e-3 <= level <= 1e3:
            return inertia, level, speed, settling


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _record(
    rng: np.random.Generator,
    kind: str,
    load: _Load,
    level: float,
    limit: float,
    speed: float,
    settling: float,
    rate: float,
    samples: int,
    unmodelled: float,
) -> tuple[Array, Array, Array]:
    """Time, torque and angle of a machine that is driven from rest."""
    time, h = np.arange(samples) / rate, 1.0 / (rate * FINE)
    extra = unmodelled * level * _smooth_noise(rng, samples)
    drive = _drive(rng, kind, load, level, speed, settling, time)
    torque, angle, velocity = np.zeros(samples), np.zeros(samples), 0.0
    at = float(rng.uniform(-2.0, 2.0))
    for k in range(samples):
        angle[k] = at
        torque[k] = float(np.clip(drive(k, at, velocity), -limit, limit))
        for _ in range(FINE):
            at, velocity = load.step(at, velocity, torque[k] + extra[k], h)
    return time, torque, angle


def _drive(
    rng: np.random.Generator, kind: str, load: _Load, level: float, speed: float, settling: float, time: Array
) -> Callable[[int, float, float], float]:
    """Torque asked for at a sample, an angle and a velocity."""
    samples, dt = time.size, float(time[1])
    if kind in ("moves", "stick_slip"):
        steps = rng.integers(3, 12)
        swift = min(0.2 / dt, 20.0 / min(settling, float(time[-1])))
        reach = level / (load.inertia * swift**2)  # what the controller can ask for without its limit
        goals = 20.0 * reach * rng.uniform(-1.0, 1.0, steps)
        places = np.arange(samples) * steps / samples
        goal = goals[places.astype(int)] if kind == "moves" else np.interp(places, np.arange(steps), goals)
        stiff, damping = load.inertia * swift**2, 2.0 * load.inertia * swift
        return lambda k, angle, velocity: stiff * (goal[k] - angle) - damping * velocity
    if kind == "tones":
        waves = rng.uniform(1.0, samples / 10.0, 4) / float(time[-1])
        command = level / 2.0 * sum(np.sin(2 * np.pi * f * time + 6.0 * rng.random()) for f in waves)
    else:
        hold = max(1, int(_log_uniform(rng, 1.0, samples / 8.0)))
        values = {"prbs": rng.choice([-1.0, 1.0], samples), "standstill": 0.25 * rng.uniform(-1, 1, samples)}
        command = level * np.repeat(values.get(kind, rng.uniform(-1.0, 1.0, samples)), hold)[:samples]
    return lambda k, angle, velocity: float(command[k])


def _smooth_noise(rng: np.random.Generator, samples: int) -> Array:
    """Of unit size, and slow against the sampling."""
    width = max(2, samples // 50)
    kernel = np.hanning(2 * width + 1)[1:-1]
    noise = np.convolve(rng.standard_normal(samples + 2 * kernel.size), kernel, mode="same")[kernel.size : -kernel.size]
    return np.asarray(noise / np.std(noise))
