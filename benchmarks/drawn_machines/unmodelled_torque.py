"""The unmodelled torque: a random smooth function of angle, velocity, both, and slow time.

A sum of waves over the variables, with wavelengths of the order of the motion's range (random Fourier features). Over
an angle of more than a turn it repeats with each turn.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sin

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_OVER = ("angle", "velocity", "both", "time")
_WAVES = 3  # for each variable


@dataclass(frozen=True)
class Rest:
    """Waves (W, 4) of amplitude, angle, velocity and time with a phase (W,)."""

    waves: tuple[tuple[float, float, float, float, float], ...]

    def __call__(self, x: float, v: float, t: float) -> float:
        total = 0.0
        for size, over_angle, over_velocity, over_time, phase in self.waves:
            total += size * sin(over_angle * x + over_velocity * v + over_time * t + phase)
        return total

    def along(self, x: Array, v: Array, t: Array) -> Array:
        """The torque along a motion."""
        size, *wave, phase = np.array(self.waves).T
        return np.asarray(np.sin(np.column_stack((x, v, t)) @ np.array(wave) + phase) @ size)

    def scaled(self, factor: float) -> Rest:
        """The torque times a factor."""
        return Rest(tuple((size * factor, *wave) for size, *wave in self.waves))  # type: ignore[misc]


def drawn_rest(rng: np.random.Generator, span: float, speed: float, duration: float) -> Rest:
    """A random function over at least two of four kinds of variables, not scaled."""
    kinds = rng.permutation(_OVER)[: int(rng.integers(2, 5))]
    waves = []
    for kind in kinds:
        weight = rng.uniform(0.4, 1.0)
        for _ in range(_WAVES):
            wave = rng.normal() * 2.0 * np.pi / span if span < 2.0 * np.pi else float(rng.integers(1, 4))
            over_angle = wave if kind in ("angle", "both") else 0.0
            over_velocity = rng.normal() * 1.2 / speed if kind in ("velocity", "both") else 0.0
            over_time = rng.normal() * 2.0 * np.pi / duration if kind == "time" else 0.0
            phase = rng.uniform(0.0, 2.0 * np.pi)
            waves.append((weight, float(over_angle), float(over_velocity), float(over_time), float(phase)))
    return Rest(tuple(waves))
