"""A torque that was measured, between its samples."""

from __future__ import annotations

import numpy as np

from plant.effects.effect import Array


def supporting_points(torque: Array) -> Array:
    """(T,) values that straight lines connect so that they have what a smooth torque (T,) has [N m].

    Straight lines between the samples themselves lose the share (w Ts)^2 / 12 of a torque of frequency w, which is what
    a twelfth of the second difference holds.
    """
    found = np.array(torque, dtype=float)
    if found.size > 2:
        found[1:-1] -= np.diff(torque, 2) / 12.0
    return found
