"""The limits of a gear train's two pinions, whose drives are alike."""

from __future__ import annotations

from dataclasses import dataclass

from allocation.limits import Limits
from plant.gears import GearTrain


@dataclass(frozen=True, kw_only=True)
class Bounds(Limits):
    """`Limits` of two drives that are alike, on one follower; accelerations and torques may be arrays over time.

    Attributes:
        gears: the gear train.
        min_torque: least torque of each pinion and of each flank, seen from the pinion [N m].
        max_torque: greatest torque of each pinion [N m].
        rotor_inertia: of each motor, at its shaft [kg m^2]; zero leaves rotors out.
        motor_friction: dry friction of each motor, at its shaft [N m].

    Raises:
        BadParameter: a number that is not finite or negative.
        InfeasibleTorque: min_torque above max_torque: nothing is admitted.
    """

    gears: GearTrain
    min_torque: float
    max_torque: float
    rotor_inertia: float = 0.0
    motor_friction: float = 0.0
