"""A measured torque between its samples."""

from __future__ import annotations

import numpy as np

from plant.effects.effect import Array


def supporting_points(torque: Array) -> Array:
    """(T,) values whose linear interpolation represents a smooth torque with samples (T,) [N m].

    Linear interpolation of the samples themselves loses the fraction (w Ts)^2 / 12 of a torque of frequency w; a
    twelfth of the second difference is subtracted to compensate.
    """
    found = np.array(torque, dtype=float)
    if found.size > 2:
        found[1:-1] -= np.diff(torque, 2) / 12.0
    return found
