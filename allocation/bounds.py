"""What each drive may do: unidirectional, limited, and with teeth that stay together.

Torques here are magnitudes in the required sense, sigma_i xi_i with sigma = [+1, -1], so every bound is a plain
interval and the whole machine a box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allocation.errors import InfeasibleTorque
from plant.errors import BadParameter
from plant.gears import GearTrain

Array = NDArray[np.float64]

SENSE = np.array([1.0, -1.0])
"""Signs of the pinion torques that hold the teeth together, lambda > 0 in equation (3)."""


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """Bounds on the two pinion torques.

        xi1 >= min_torque,  xi2 <= -min_torque,  |xi_i| <= max_torque

    A rotor of inertia Jm behind a pre-reduction r eats part of its motor's torque when the load accelerates by a; what
    arrives at the flank, seen from the pinion, is

        F_i = sigma_i (xi_i + (Nf/Ni) r^2 Jm a) >= min_torque        (Newton's law for the rotor, with equation 1)

    Both hold together, so the lower bound of each drive is the larger of the two.

    Attributes:
        gears: the gear train.
        min_torque: least torque of each pinion and of each flank, seen from the pinion [N m].
        max_torque: greatest torque of each pinion [N m].
        rotor_inertia: of each motor, at its shaft [kg m^2]; zero leaves the flank torque equal to the pinion torque.

    Raises:
        BadParameter: a number that is not finite or negative.
        InfeasibleTorque: min_torque above max_torque: nothing is admitted.
    """

    gears: GearTrain
    min_torque: float
    max_torque: float
    rotor_inertia: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers, and that the box is not empty."""
        for name in ("min_torque", "max_torque", "rotor_inertia"):
            value = getattr(self, name)
            if not np.isfinite(value) or value < 0:
                raise BadParameter(f"{name} must be finite and not negative, not {value!r}.")
        if self.max_torque == 0:
            raise BadParameter("max_torque must be above zero.")
        if self.min_torque > self.max_torque:
            raise InfeasibleTorque(
                f"min_torque = {self.min_torque:g} N m is above max_torque = {self.max_torque:g} N m, so no pinion "
                "torque is admitted; lower the first or raise the second."
            )

    def rotor_torque(self, acceleration: float | Array) -> Array:
        """(..., 2) torque that each rotor takes in its sense [N m] at load accelerations (...) [rad/s^2].

        Positive: the flank gets less than the motor gives.
        """
        pinion_inertia = self.rotor_inertia * self.gears.pre_reduction**2
        pinion_acceleration = np.asarray(acceleration, dtype=np.float64)[..., None] * self.gears.angle_map
        return np.asarray(SENSE * pinion_inertia * pinion_acceleration)

    def lower(self, acceleration: float | Array = 0.0) -> Array:
        """(..., 2) least magnitudes of the pinion torques [N m]; above `max_torque` where the flank cannot be held."""
        return self.min_torque + np.maximum(self.rotor_torque(acceleration), 0.0)

    def reachable(self, acceleration: float | Array = 0.0) -> Array:
        """(..., 2) least and greatest follower torque [N m] that keep every bound.

        Preload comes first: where a flank cannot be held even by the full torque of its drive, that drive gives all.
        """
        low = np.minimum(self.lower(acceleration), self.max_torque)
        n1, n2 = self.gears.mesh_ratios
        least = n2 * low[..., 1] - n1 * self.max_torque
        greatest = n2 * self.max_torque - n1 * low[..., 0]
        return np.stack((least, greatest), axis=-1)

    def margin(self, torques: Array, acceleration: float | Array = 0.0) -> Array:
        """(...,) least flank torque above `min_torque` [N m] of pinion torques (..., 2), seen from the pinion."""
        flank = SENSE * torques - self.rotor_torque(acceleration)
        return np.asarray(np.min(np.minimum(flank, SENSE * torques), axis=-1) - self.min_torque)

    def clip(self, torques: Array) -> Array:
        """Pinion torques (..., 2) moved into the box, to the last bit."""
        return np.asarray(SENSE * np.clip(SENSE * torques, self.min_torque, self.max_torque))
