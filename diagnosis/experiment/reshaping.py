"""Small random changes of a torque signal, to refine a signal beyond the families."""

from __future__ import annotations

import numpy as np

from plant.effects.effect import Array

_SHORTEST, _LONGEST = 0.01, 0.5  # width of a change, as a share of the duration
_FASTEST = 0.05  # highest frequency of an added sine, in cycles per sample


def reshaped(torque: Array, size: float, rng: np.random.Generator) -> Array:
    """(T,) the torque with a bump, a plateau or a sine added, or scaled about its median.

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
    """(T,) the torque with a part of it mirrored between its extremes, or shifted in time.

    The best signals often switch between the torque limits; adding to them does not improve them.

    Args:
        torque: (T,) [N m].
        rng: draws the change.
    """
    time, width = np.linspace(0.0, 1.0, torque.size), _width(rng)
    away = _from_somewhere(time, rng) / width
    if rng.random() < 0.5:
        return np.asarray(np.where(away < 0.5, torque.min() + torque.max() - torque, torque))
    shifted = time + 0.5 * width * rng.standard_normal() * np.maximum(1.0 - away, 0.0)
    return np.asarray(np.interp(shifted, time, torque))


def _width(rng: np.random.Generator) -> float:
    """A random width, log-uniform, as a share of the duration."""
    return float(np.exp(rng.uniform(np.log(_SHORTEST), np.log(_LONGEST))))


def _from_somewhere(time: Array, rng: np.random.Generator) -> Array:
    """(T,) distance of each time from a randomly drawn one, as a share of the duration."""
    return np.abs(time - rng.random())
