"""The limits of one or two drives on one load."""

from __future__ import annotations

from dataclasses import dataclass

from allocation.limits import Limits
from plant.drive_train import DriveTrain


@dataclass(frozen=True, kw_only=True)
class Bounds(Limits):
    """`Limits` of the drives of a drive train; accelerations and torques may be arrays over time.

    Attributes:
        gears: the drive train.
    """

    gears: DriveTrain
