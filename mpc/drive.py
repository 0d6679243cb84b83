"""The inverse of the drive: what to command so that a wanted torque comes out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from plant.effects import BackEmf, DeadZone, TorqueSaturation
from plant.servo import ServoModel


@dataclass(frozen=True, kw_only=True)
class DriveInverse:
    """Plan with the torque that the drive puts out, and command what it takes.

        e = h(clip(tau, -limit, limit) - k_e v)        (h: dead zone, eq. 6 of the paper)

    Inside a dead zone the torque does nothing, and beyond a limit no more than at it, so a linearisation there sees no
    way to move; in e the servo is smooth. The command jumps by twice the half width where the wanted torque changes
    sign; a ramp over a tenth of the half width keeps noise from making it chatter.

    Numbers, arrays that broadcast, or expressions.

    Attributes:
        half_width: gamma [N m]; zero is no dead zone.
        back_emf: k_e, torque lost per speed [N m s/rad].
        limit: largest torque that the drive gives [N m].
    """

    half_width: Any = 0.0
    back_emf: Any = 0.0
    limit: Any = float("inf")

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

    def effective(self, torque: Any, velocity: Any = 0.0) -> Any:
        """The torque behind the drive [N m] at a velocity of the load [rad/s]."""
        left = clip(torque, -self.limit, self.limit) - self.back_emf * velocity
        return left - clip(left, -self.half_width, self.half_width)

    def command(self, effective: Any, velocity: Any = 0.0) -> Any:
        """The torque to command for a torque behind the drive [N m] at a velocity [rad/s]."""
        return effective + clip(10.0 * effective, -self.half_width, self.half_width) + self.back_emf * velocity


def clip(value: Any, least: Any, greatest: Any) -> Any:
    """A number, an array or an expression, moved into an interval."""
    if isinstance(value, ca.SX):
        return ca.fmax(ca.fmin(value, greatest), least)
    return np.clip(value, least, greatest)
