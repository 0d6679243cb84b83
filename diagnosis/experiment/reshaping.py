"""Small changes of a torque signal: what the design tries when no family has the shape that is needed."""

from __future__ import annotations

import numpy as np

from plant.effects.effect import Array

_SHORTEST, _LONGEST = 0.01, 0.5  # width of what is changed, as a share of the duration
_FASTEST = 0.05  # cycles per sample of a sine that is added


def changed(torque: Array, size: float, rng: np.random.Generator) -> Array:
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
    away = np.abs(time - rng.random()) / float(np.exp(rng.uniform(np.log(_SHORTEST), np.log(_LONGEST))))
    return np.asarray(torque + height * (np.maximum(1.0 - away, 0.0) if kind == "bump" else away < 0.5))
