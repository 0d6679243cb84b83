"""The inverse of a dead zone: what to command so that a wanted torque comes out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plant.effects import DeadZone
from plant.servo import ServoModel

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class DeadZoneInverse:
    """Plan with the torque behind the dead zone, and command what it takes.

    Inside a dead zone the torque does nothing, so a linearisation there sees no way to move; in the torque behind it
    the servo is smooth. The command jumps by twice the half width where the wanted torque changes sign; a ramp over a
    tenth of the half width keeps noise from making it chatter.

    Attributes:
        half_width: gamma [N m]; zero is no dead zone.
    """

    half_width: float

    @classmethod
    def of(cls, model: ServoModel) -> DeadZoneInverse:
        """The inverse for a model, whether or not it has a dead zone."""
        effect = model.effect("dead_zone")
        return cls(half_width=float(effect.half_width) if isinstance(effect, DeadZone) else 0.0)

    def effective(self, torque: ArrayLike) -> Array:
        """The torque behind the dead zone [N m], shape of the input (paper, eq. 6)."""
        tau = np.asarray(torque, dtype=np.float64)
        return np.asarray(tau - np.clip(tau, -self.half_width, self.half_width))

    def command(self, effective: ArrayLike) -> Array:
        """The torque to command for a torque behind the dead zone [N m], shape of the input."""
        h = np.asarray(effective, dtype=np.float64)
        return np.asarray(h + np.clip(10.0 * h, -self.half_width, self.half_width))
