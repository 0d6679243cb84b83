"""The inverse of the drive: the command that gives a wanted output torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from plant.effects import BackEmf, DeadZone, TorqueSaturation
from plant.servo import ServoModel


@dataclass(frozen=True, kw_only=True)
class DriveInverse:
    """Plan with the output torque e of the drive, and compute the command from it.

        e = h(clip(tau, -limit, limit) - k_e v)        (h: dead zone, eq. 6 of the paper)

    Inside the dead zone and beyond the limit the torque has zero gradient, so a linearisation in tau finds no
    direction to move; in e the servo is smooth. The command jumps by twice the half width where the wanted torque
    changes sign; a ramp over a tenth of the half width on each side prevents chattering due to noise.

    All values may be numbers, arrays that broadcast, or expressions.

    Attributes:
        half_width: gamma [N m]; zero: no dead zone.
        back_emf: k_e, torque loss per speed [N m s/rad].
        limit: largest torque of the drive [N m].
    """

    half_width: Any = 0.0
    back_emf: Any = 0.0
    limit: Any = float("inf")

    @classmethod
    def of(cls, model: ServoModel) -> tuple[DriveInverse, ServoModel]:
        """The inverse for a model, and the rest of the model, with the drive output torque as its input."""
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

    def effective(self, torque: Any, velocity: Any = 0.0) -> Any:
        """The drive output torque [N m] for a command at a velocity of the load [rad/s]."""
        left = clip(torque, -self.limit, self.limit) - self.back_emf * velocity
        return left - clip(left, -self.half_width, self.half_width)

    def command(self, effective: Any, velocity: Any = 0.0) -> Any:
        """The command for a drive output torque [N m] at a velocity of the load [rad/s]."""
        return effective + clip(10.0 * effective, -self.half_width, self.half_width) + self.back_emf * velocity


def clip(value: Any, least: Any, greatest: Any) -> Any:
    """A number, an array or an expression, clipped to an interval."""
    if isinstance(value, ca.SX):
        return ca.fmax(ca.fmin(value, greatest), least)
    return np.clip(value, least, greatest)
