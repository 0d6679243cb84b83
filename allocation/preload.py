"""Preload in the units of drive manufacturers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plant.errors import BadParameter
from plant.gears import GearTrain

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Preload:
    """How hard two drives push against each other.

    The preload is defined by lambda; its torques give no output torque. The other quantities follow from it:

        torques        xi = lambda [N1, -N2]                          (equation 3 at no output torque)
        difference     d = xi1 - xi2 = lambda (N1 + N2)               (2 lambda N for equal gears)
        percent        100 d / rated torque of one drive              ("tension" of SEW)
        per mille      1000 d / rated torque of one drive

    All have the sign of lambda: positive for [+ -], with a positive torque of drive 1. Manufacturers with the opposite
    sign have their first drive at D2. Note a factor of two: the preload in % of the rated torque of FANUC and Fagor,
    and the torque offset in per mille of CiA 402, are values of *each* drive (`torques` over the rated torque).

    Attributes:
        gears: the gear train.
        coefficient: lambda [N m per tooth].

    Raises:
        BadParameter: lambda is not finite, or a rated torque is not positive.
    """

    gears: GearTrain
    coefficient: float

    def __post_init__(self) -> None:
        """Check the number."""
        if not np.isfinite(self.coefficient):
            raise BadParameter(f"A preload must be finite, not {self.coefficient!r}.")

    @classmethod
    def from_difference(cls, gears: GearTrain, difference: float) -> Preload:
        """From the difference of the two pinion torques at no output torque [N m]."""
        return cls(gears=gears, coefficient=difference / sum(gears.pinion_teeth))

    @classmethod
    def from_percent(cls, gears: GearTrain, percent: float, *, rated_torque: float) -> Preload:
        """From the difference in % of the rated torque of one drive [N m], seen from the pinion."""
        return cls.from_difference(gears, percent / 100 * _rated(rated_torque))

    @classmethod
    def from_per_mille(cls, gears: GearTrain, per_mille: float, *, rated_torque: float) -> Preload:
        """From the difference in per mille of the rated torque of one drive [N m], seen from the pinion."""
        return cls.from_difference(gears, per_mille / 1000 * _rated(rated_torque))

    @property
    def torques(self) -> Array:
        """(2,) pinion torques at no output torque [N m]."""
        return np.asarray(self.coefficient * self.gears.null_vector)

    @property
    def difference(self) -> float:
        """Difference of the two pinion torques at no output torque [N m]."""
        return self.coefficient * sum(self.gears.pinion_teeth)

    def percent(self, rated_torque: float) -> float:
        """The difference in % of the rated torque of one drive [N m], seen from the pinion."""
        return 100 * self.difference / _rated(rated_torque)

    def per_mille(self, rated_torque: float) -> float:
        """The difference in per mille of the rated torque of one drive [N m], seen from the pinion."""
        return 1000 * self.difference / _rated(rated_torque)

    def pinion_torques(self, torque: float) -> Array:
        """(2,) pinion torques with this preload that give an output torque [N m], equation (3)."""
        return self.gears.pinion_torques(torque, self.coefficient)


def _rated(torque: float) -> float:
    if not (np.isfinite(torque) and torque > 0):
        raise BadParameter(f"rated_torque must be finite and above zero, not {torque!r}.")
    return torque
