"""Limits of each drive: unidirectional, bounded, and without loss of contact.

Many torques here are magnitudes in the required direction, sigma_i xi_i (sigma = [+1, -1] for the paper's machine).
Each bound is then an interval, and the feasible torques of all drives form a box.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allocation.errors import InfeasibleTorque
from allocation.structure import Structure
from plant.drive_train import DriveTrain
from plant.errors import BadParameter
from plant.number import refuse_huge

Array = NDArray[np.float64]
PerDrive = float | tuple[float, ...]
"""One number for all drives, or one for each."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of m drives. For the two pinions of a gear train they are

        xi1 >= min_torque,  xi2 <= -min_torque,  |xi_i| <= max_torque

    The rotor inertia Jm with reduction r takes a part of the motor torque at joint acceleration a, and the motor
    friction f changes it by up to r f in either direction. The worst-case contact torque at the tooth flank, seen from
    the drive (pinion), is

        F_i = sigma_i (xi_i - r^2 Jm (A' a)_i) - r f >= min_torque      (Newton's law for the rotor, with equation 1)

    Motor and contact torque both have this minimum, so the lower bound of a drive is the larger of the two bounds. A
    single drive cannot be preloaded: it drives in both directions, and only its greatest torque is limited.

    Attributes:
        gears: the drives and their load: a gear train, ratios, or the structure of another machine.
        min_torque: minimum motor and contact torque of each drive, seen from the drive [N m].
        max_torque: greatest torque of each drive [N m].
        rotor_inertia: of each motor, at its shaft [kg m^2].
        motor_friction: dry friction of each motor, at its shaft [N m].

    Raises:
        BadParameter: a number that is not finite or negative, or not one for each drive.
        InfeasibleTorque: min_torque above max_torque, so no torque is admitted.
    """

    gears: DriveTrain | Structure
    min_torque: PerDrive
    max_torque: PerDrive
    rotor_inertia: PerDrive = 0.0
    motor_friction: PerDrive = 0.0

    def __post_init__(self) -> None:
        """Check the numbers, and that the box is not empty."""
        for name in ("min_torque", "max_torque", "rotor_inertia", "motor_friction"):
            per_drive(name, getattr(self, name), self.structure.drives)
        if np.any(self.greatest == 0):
            raise BadParameter("max_torque must be above zero.")
        if np.any(self.least > self.greatest):
            worst = int(np.argmax(self.least - self.greatest))
            raise InfeasibleTorque(
                f"min_torque = {self.least[worst]:g} N m of drive {worst + 1} is above its max_torque = "
                f"{self.greatest[worst]:g} N m, so no torque is admitted; lower the first or raise the second."
            )

    @cached_property
    def structure(self) -> Structure:
        """Which drive turns which joint."""
        return Structure.of(self.gears)

    @cached_property
    def least(self) -> Array:
        """(m,) min_torque of each drive [N m]; zero for a single drive."""
        return self._held(per_drive("min_torque", self.min_torque, self.structure.drives))

    @cached_property
    def greatest(self) -> Array:
        """(m,) max_torque of each drive [N m]."""
        return per_drive("max_torque", self.max_torque, self.structure.drives)

    @cached_property
    def rotor_inertias(self) -> Array:
        """(m,) of each motor, at its shaft [kg m^2]."""
        return per_drive("rotor_inertia", self.rotor_inertia, self.structure.drives)

    @cached_property
    def friction(self) -> Array:
        """(m,) dry friction of each motor, seen from the drive [N m]."""
        at_shaft = per_drive("motor_friction", self.motor_friction, self.structure.drives)
        return self._held(at_shaft * self.structure.reductions)

    def _held(self, torques: Array) -> Array:
        """The given torques; zeros for a single drive, which cannot be preloaded."""
        return torques if self.structure.drives > 1 else np.zeros_like(torques)

    @cached_property
    def lowest(self) -> Array:
        """(m,) least torque of each motor in its direction [N m]; -max_torque for a single drive."""
        return self.least if self.structure.drives > 1 else -self.greatest

    @cached_property
    def floor(self) -> Array:
        """(m,) torque that each drive needs at rest to keep contact [N m]: minimum torque plus friction."""
        return self.least + self.friction

    @cached_property
    def _rotor(self) -> Array:
        """(n, m) torque that accelerates each rotor, in its drive's direction, for 1 rad/s^2 of each joint [N m]."""
        return self.structure.pushing * self.rotor_inertias * self.structure.reductions**2

    def rotor_torque(self, acceleration: ArrayLike) -> Array:
        """(..., m) torque that accelerates each rotor [N m]; positive: the contact torque is below the motor torque.

        Args:
            acceleration: of the joint [rad/s^2], shape (...); of several joints, shape (..., n).
        """
        a = np.asarray(acceleration, dtype=np.float64)
        return np.asarray(a[..., None] * self._rotor[0] if self.structure.joints == 1 else a @ self._rotor)

    def lower(self, acceleration: ArrayLike = 0.0, floor: Array | None = None) -> Array:
        """(..., m) least magnitudes of the torques [N m]; above `max_torque` where contact cannot be kept.

        Args:
            acceleration: as for `rotor_torque`.
            floor: (m,) minimum torque plus friction [N m], in place of `self.floor` while the preload is built up.
        """
        if self.structure.drives == 1:
            return np.broadcast_to(self.lowest, self.rotor_torque(acceleration).shape)
        held = self.floor if floor is None else floor
        return np.maximum(np.minimum(held, self.least), held + self.rotor_torque(acceleration))

    def reachable(self, acceleration: ArrayLike = 0.0) -> Array:
        """(..., 2) least and greatest torque [N m] on a single joint that keep every bound.

        Preload has priority: a drive that cannot keep contact even with its greatest torque gives its greatest torque.

        Raises:
            BadParameter: there are several joints; their reachable torques are not an interval.
        """
        if self.structure.joints != 1:
            raise BadParameter(f"{self.structure.joints} joints have no interval of reachable torques.")
        pushing = self.structure.pushing[0]
        low, high = pushing * np.minimum(self.lower(acceleration), self.greatest), pushing * self.greatest
        return np.stack((np.minimum(low, high).sum(axis=-1), np.maximum(low, high).sum(axis=-1)), axis=-1)

    def margin(self, torques: Array, acceleration: ArrayLike = 0.0) -> Array:
        """(...,) smallest motor or contact torque minus `min_torque` [N m] for torques (..., m), seen from the drive.

        Zero for a single drive, which has no preload.
        """
        if self.structure.drives == 1:
            return np.zeros(np.shape(torques)[:-1])
        motor = self.structure.signs * torques
        flank = motor - self.rotor_torque(acceleration) - self.friction
        return np.asarray(np.min(np.minimum(flank, motor) - self.least, axis=-1))

    def clip(self, torques: Array) -> Array:
        """Torques (..., m) clipped to the limits of the drives, to the last bit."""
        signs = self.structure.signs
        return np.asarray(signs * np.clip(signs * torques, self.lowest, self.greatest))


def per_drive(name: str, value: PerDrive, drives: int) -> Array:
    """(m,) one number for each drive.

    Raises:
        BadParameter: a number is not finite or is negative, or there is not one for each drive.
    """
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise BadParameter(f"{name} must be a number, or one for each of the {drives} drives, not {value!r}.") from None
    if numbers.shape not in ((), (drives,)):
        raise BadParameter(f"{name} must be one number, or one for each of the {drives} drives, not {value!r}.")
    if not np.all(np.isfinite(numbers)) or np.any(numbers < 0):
        raise BadParameter(f"{name} must be finite and not negative, not {value!r}.")
    refuse_huge(name, float(np.max(numbers)))
    return np.broadcast_to(numbers, (drives,)).copy()
