"""The inverse of the drive: what to command so that a wanted torque comes out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plant.effects import BackEmf, DeadZone, TorqueSaturation
from plant.servo import ServoModel

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class DriveInverse:
    """Plan with the torque that the drive puts out, and command what it takes.

        e = h(clip(tau, -limit, limit) - k_e v)        (h: dead zone, eq. 6 of the paper)

    Inside a dead zone the torque does nothing, and beyond a limit no more than at it, so a linearisation there sees no
    way to move; in e the servo is smooth. The command jumps by twice the half width where the wanted torque changes
    sign; a ramp over a tenth of the half width keeps noise from making it chatter.

    Attributes:
        half_width: gamma [N m]; zero is no dead zone.
        back_emf: k_e, torque lost per speed [N m s/rad].
        limit: largest torque that the drive gives [N m].
    """

    half_width: float = 0.0
    back_emf: float = 0.0
    limit: float = float("inf")

    @classmethod
    def of(cls, model: ServoModel) -> tuple[DriveInverse, ServoModel]:
        """The inverse for a model, and the model behind it: what the planned torque moves."""
        known: dict[str, float] = {}
        for effect in model.effects:
            match effect:
                case DeadZone():
                    known["half_width"] = effect.half_width
                case BackEmf():
                    known["back_emf"] = effect.constant
                case TorqueSaturation():
                    known["limit"] = effect.limit
                case _:
                    continue
            model = model.without_effect(effect.name)
        return cls(**known), model

    def effective(self, torque: ArrayLike, velocity: ArrayLike = 0.0) -> Array:
        """The torque behind the drive [N m] at a velocity of the load [rad/s]; the shapes broadcast."""
        left = np.clip(np.asarray(torque, dtype=np.float64), -self.limit, self.limit)
        left = left - self.back_emf * np.asarray(velocity, dtype=np.float64)
        return np.asarray(left - np.clip(left, -self.half_width, self.half_width))

    def command(self, effective: ArrayLike, velocity: ArrayLike = 0.0) -> Array:
        """The torque to command for a torque behind the drive [N m] at a velocity [rad/s]; the shapes broadcast."""
        e = np.asarray(effective, dtype=np.float64)
        lost = self.back_emf * np.asarray(velocity, dtype=np.float64)
        return np.asarray(e + np.clip(10.0 * e, -self.half_width, self.half_width) + lost)
