"""Small changes of a torque signal: what the design tries when no family has the shape that is needed."""

from __future__ import annotations

import numpy as np

from plant.effects.effect import Array

_SHORTEST, _LONGEST = 0.01, 0.5  # width of what is changed, as a share of the duration
_FASTEST = 0.05  # cycles per sample of a sine that is added


def reshaped(torque: Array, size: float, rng: np.random.Generator) -> Array:
    """(T,) the torque with a bump, a plateau or a sine added, or larger or smaller about its middle.

    Args:
        torque: (T,) [N m].
        size: standard deviation of the change's height [N m].
        rng: draws the change.
    """
    time = np.linspace(0.0, 1.0, torque.size)
    height = size * float(rng.standard_normal())
    kind = rng.choice(("bump", "plateau", "sine", "scale"))
    if kind == "scale":
        middle = float(np.median(torque))
        return np.asarray(middle + (torque - middle) * np.exp(height / max(float(np.ptp(torque)), size)))
    if kind == "sine":
        cycles = float(np.exp(rng.uniform(0.0, np.log(max(_FASTEST * torque.size, 1.0)))))
        return np.asarray(torque + 0.3 * height * np.sin(2.0 * np.pi * (cycles * time + rng.random())))
    away = _from_somewhere(time, rng) / _width(rng)
    return np.asarray(torque + height * (np.maximum(1.0 - away, 0.0) if kind == "bump" else away < 0.5))


def rearranged(torque: Array, rng: np.random.Generator) -> Array:
    """(T,) the torque with a stretch of it turned over about its middle, or shifted in time.

    What switches between its limits, as the best signals often do, gets no better by what is added to it.

    Args:
        torque: (T,) [N m].
        rng: draws what is moved.
    """
    time, width = np.linspace(0.0, 1.0, torque.size), _width(rng)
    away = _from_somewhere(time, rng) / width
    if rng.random() < 0.5:
        return np.asarray(np.where(away < 0.5, torque.min() + torque.max() - torque, torque))
    shifted = time + 0.5 * width * rng.standard_normal() * np.maximum(1.0 - away, 0.0)
    return np.asarray(np.interp(shifted, time, torque))


def _width(rng: np.random.Generator) -> float:
    """Of what is changed, as a share of the duration."""
    return float(np.exp(rng.uniform(np.log(_SHORTEST), np.log(_LONGEST))))


def _from_somewhere(time: Array, rng: np.random.Generator) -> Array:
    """(T,) how far each time is from one that is drawn, as shares of the duration."""
    return np.abs(time - rng.random())
