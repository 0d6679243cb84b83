"""Randomly drawn machines: inertia, gravity, friction, noise, commands and the shape of what is hidden, from a seed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from hidden_effects import Hidden
from machine import (
    Array,
    Follower,
    Loop,
    Machine,
    excitation,
    load_fluctuation,
    random_steps,
    record,
    wandering_reference,
)

from identification.log import Log

DT, DURATION = 0.005, 30.0  # of a log before it is stretched [s]
COMMANDS = ("chirps and steps", "random steps", "tones", "moves in a loop", "point to point in a loop")


@dataclass(frozen=True, kw_only=True)
class Bench:
    """A randomly drawn machine and how it is driven and recorded; its log is stretched by `slower` and `stronger`."""

    host: Machine
    commands: str
    strength: float
    noise: float
    bits: int
    load: float
    slower: float
    stronger: float

    @staticmethod
    def drawn(seed: int) -> Bench:
        rng = np.random.default_rng([seed, 21])
        inertia = 2.0  # with time and torque stretched, of no account
        friction = inertia / np.exp(rng.uniform(np.log(0.4), np.log(6.0)))
        swing = rng.choice([0.0, 1.0], p=[0.3, 0.7]) * np.exp(rng.uniform(np.log(0.3), np.log(3.0)))
        half_width = rng.choice([0.0, 1.0]) * rng.uniform(0.1, 1.0)
        return Bench(
            host=Machine(
                inertia=inertia,
                gravity=inertia * swing**2,
                viscous_friction=friction,
                effects={"dead_zone": {"half_width": half_width}} if half_width else {},
            ),
            commands=str(rng.choice(COMMANDS)),
            strength=float(np.exp(rng.uniform(np.log(0.5), np.log(2.0)))),
            noise=float(np.exp(rng.uniform(np.log(1e-4), np.log(3e-3)))),
            bits=int(rng.choice([13, 15, 17])),
            load=float(rng.choice([0.0, 0.0, 0.01, 0.03])),
            slower=float(np.exp(rng.uniform(np.log(0.1), np.log(4.0)))),
            stronger=float(np.exp(rng.uniform(np.log(1e-4), np.log(100.0)))),
        )

    def played(self, seed: int, duration: float) -> Array | Loop:
        """A command (T,) [N m], or a loop, before it is stretched."""
        rng = np.random.default_rng([seed, 22])
        count = round(duration / DT)
        t = np.arange(count) * DT
        if self.commands == "chirps and steps":
            return excitation(seed, duration=duration, scale=self.strength)
        if self.commands == "random steps":
            return self.strength * random_steps(rng, 1.0, 8.0, duration, DT)
        if self.commands == "tones":
            tones, phases = np.exp(rng.uniform(np.log(0.1), np.log(5.0), 8)), rng.uniform(0.0, 2.0 * np.pi, 8)
            return np.asarray(2.0 * self.strength * np.sin(2.0 * np.pi * np.outer(t, tones) + phases).sum(axis=1))
        path = self.strength * wandering_reference(seed, duration=duration)
        if self.commands == "point to point in a loop":
            path = _point_to_point(rng, self.strength, count)
        return Follower(reference=path, limit=40.0)

    def log(self, machine: Machine, seed: int, *, duration: float = DURATION, sign: float = 1.0) -> Log:
        """What the machine logs, before it is stretched."""
        extra = load_fluctuation(seed, self.load, (round(duration / DT), 1))
        played = self.played(seed, duration)
        return record(machine, played, seed=seed, noise=sign * self.noise, bits=self.bits, load_torque=extra).log()

    def stretched(self, log: Log) -> Log:
        runs = (replace(r, time=self.slower * r.time, command=self.stronger * r.command) for r in log.runs)
        return replace(log, runs=tuple(runs))


def _point_to_point(rng: np.random.Generator, strength: float, count: int) -> Array:
    """(T,) moves of a positioning drive: a limited speed and acceleration, and a rest after each [rad]."""
    parts: list[Array] = []
    at = 0.0
    while sum(map(len, parts)) < count:
        target = strength * rng.uniform(-2.0, 2.0)
        time_taken = rng.uniform(0.6, 2.0)
        s = np.linspace(0.0, 1.0, round(time_taken / DT))
        parts += [at + (target - at) * s**2 * (3.0 - 2.0 * s), np.full(round(rng.uniform(0.1, 0.8) / DT), target)]
        at = target
    return np.concatenate(parts)[:count]


def shaped(case: Hidden, bench: Bench, seed: int) -> Hidden:
    """A case of the catalogue's in another host, in a random shape."""
    rng = np.random.default_rng([seed, 23])
    (run,) = bench.log(bench.host, seed, sign=0.0).runs
    low, high = float(run.output.min()), float(run.output.max())
    fraction, phase = rng.uniform(0.0, 1.0), rng.uniform(-np.pi, np.pi)

    def between(least: float, most: float) -> float:
        return float(least * (most / least) ** fraction)

    lot: dict[str, dict[str, float]] = {
        "stribeck_friction": {"velocity": between(0.05, 0.5)},
        "cogging": {"order": float(round(between(2.0, 40.0))), "phase": phase},
        "compliance": {"damping": between(0.02, 0.15), "motor_share": 0.15 + 0.7 * rng.uniform()},
        "backlash": {"motor_share": 0.15 + 0.7 * fraction},
        "cable_stiffness": {"rest_angle": low + fraction * (high - low)},
        "payload_change": {"time": (0.3 + 0.4 * fraction) * DURATION},
        "periodic_disturbance": {"frequency": between(0.5, 20.0), "phase": phase},
        "encoder_eccentricity": {"order": float(rng.integers(1, 3)), "phase": phase},
    }
    ratio = between(10.0, 200.0)

    def at(size: float) -> dict[str, float]:
        values = {**case.at(size), **lot.get(case.effect, {})}
        if case.effect == "end_stop":
            values = {"angle": high - size * (high - low), "stiffness": ratio}
        if case.effect == "presliding_hysteresis":
            values["stiffness"] = ratio * size
        if case.effect == "torque_saturation":
            top = float(np.abs(run.command).max())
            values["limit"] = top * 0.5 / size
        return values

    host = replace(bench.host, effects={}) if case.effect == "dead_zone" else bench.host
    return replace(case, at=at, host=host)
