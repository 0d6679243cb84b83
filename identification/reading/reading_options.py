"""Options to read a log: names and units of its columns, and facts that are not in the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypedDict

import numpy as np

from identification.log_columns import ALIASES, COLUMNS
from plant.drive_train import DriveTrain
from plant.errors import BadParameter


class How(TypedDict, total=False):
    """The fields of `Reading`, as the keywords of functions that read a log."""

    mapping: Mapping[str, str]
    units: Mapping[str, str]
    scales: Mapping[str, float]
    gears: DriveTrain | None
    rate: float | None
    torque_constant: float | None
    kp: float | None
    kd: float | None
    joint: str | None


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How the columns of a file become the columns of the log contract.

    mapping: contract column -> its name in the file, or its number ("3" is the third column).
    units: contract column -> unit of its (scaled) values.
    scales: contract column -> factor on the file's values, applied before the unit.
    gears: needed when only the pinion torques, or the currents of their motors, were logged.
    rate: samples per second of a file without a time [Hz].
    torque_constant: torque per current, for a log of the motor's current [N m/A]; [N/A] on a linear axis.
    kp, kd: gains of a position servo, for a log of its set-point [N m/rad], [N m s/rad]; on a linear axis [N/m],
        [N s/m].
    joint: the joint to be read from a log that has several.

    Raises `BadParameter` for columns that no log has, and for invalid numbers.
    """

    mapping: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    scales: Mapping[str, float] = field(default_factory=dict)
    gears: DriveTrain | None = None
    rate: float | None = None
    torque_constant: float | None = None
    kp: float | None = None
    kd: float | None = None
    joint: str | None = None

    def __post_init__(self) -> None:
        """Check columns and numbers; replace older names by the present ones."""
        for option, name in (("mapping", "mapping"), ("unit", "units"), ("scale", "scales")):
            given = {ALIASES.get(column, column): value for column, value in getattr(self, name).items()}
            for column in given:
                if column not in COLUMNS or (column == "run" and option != "mapping"):
                    raise BadParameter(f"{option} for '{column}': a log has the columns {', '.join(COLUMNS)}.")
            object.__setattr__(self, name, given)
        for column, scale in self.scales.items():
            if not (isinstance(scale, int | float | np.number) and np.isfinite(scale) and scale != 0):
                raise BadParameter(f"the scale of column '{column}' is {scale!r}, give a number other than 0.")
        for name in ("rate", "torque_constant", "kp", "kd"):
            value = getattr(self, name)
            if value is not None and not (isinstance(value, int | float | np.number) and np.isfinite(value)):
                raise BadParameter(f"{name} is {value!r}, give a number.")
        for name in ("rate", "kp"):
            if (value := getattr(self, name)) is not None and not value > 0:
                raise BadParameter(f"{name} is {value:g}, it must be positive.")
