"""Objects of CiA 402 (IEC 61800-7-201), the drive profile of CANopen and EtherCAT, among the columns of a log.

Their values are in units of the drive: positions in its increments, torques in per mille of the motor's rated torque
(6076h). The log does not have the size of these units, so the user must give it; SI is never assumed.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from identification.errors import MalformedLog


@dataclass(frozen=True, kw_only=True)
class DriveObject:
    """One object: its index, its name in the profile, the contract column on a rotary and on a linear axis.

    units: size of one step of its value, as an example for `--unit`.
    counted_in: the unit of its value, for messages.
    """

    index: str
    name: str
    columns: tuple[str, str]
    units: tuple[str, str]
    counted_in: str

    def is_called(self, column: str) -> bool:
        """Whether a column has its name or index: "Axis 1.Position actual value", "0x6064", "6064h", "16#6064:00"."""
        words = re.sub(r"[\W_]+", " ", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", column)).lower().split()
        if " ".join(self.name.split()) in " ".join(words):
            return True
        marked = rf"(?<![0-9A-Za-z])(0x|16#){self.index}(?![0-9A-Fa-f])|(?<![0-9A-Za-z]){self.index}h(?![0-9A-Za-z])"
        sub = r"([:./_](0x)?0+)?h?"
        return bool(re.search(marked, column, re.I) or re.fullmatch(rf"\s*{self.index}{sub}\s*", column, re.I))


_INCREMENTS = ("turn/131072", "mm/10000")
_RATED = ("2.4Nm/1000", "120N/1000")
OBJECTS = (
    DriveObject(
        index="6064",
        name="position actual value",
        columns=("angle", "position"),
        units=_INCREMENTS,
        counted_in="increments of the drive",
    ),
    DriveObject(
        index="606c",
        name="velocity actual value",
        columns=("velocity", "velocity"),
        units=("turn/131072/s", "mm/10000/s"),
        counted_in="a unit of the drive",
    ),
    DriveObject(
        index="6077",
        name="torque actual value",
        columns=("torque", "force"),
        units=_RATED,
        counted_in="per mille of the rated torque",
    ),
    DriveObject(
        index="6071",
        name="target torque",
        columns=("torque", "force"),
        units=_RATED,
        counted_in="per mille of the rated torque",
    ),
)


_COMMANDED = "6071"  # the better one of two torques: a measured torque is filtered and noisy


def _index(column: str) -> str:
    known = drive_object(column)
    return known.index if known else ""


def drive_object(column: str) -> DriveObject | None:
    """The object in a column of a file, None for any other column."""
    return next((known for known in OBJECTS if known.is_called(column)), None)


def find_objects(file: str, names: Collection[str], found: Mapping[str, str], *, linear: bool) -> dict[str, str]:
    """Contract column -> the file's column, for contract columns that are missing and that an object has.

    Raises `MalformedLog` if two columns of the file are possible.
    """
    taken = set(found.values())
    new: dict[str, str] = {}
    if "torque_1" in found or "setpoint" in found:  # the command is known
        found = {**found, "torque": "", "force": ""}
    for name in names:
        known = None if name in taken else drive_object(name)
        column = known.columns[linear] if known else ""
        if known is None or column in found:
            continue
        if column in new:
            best = next((n for n in (name, new[column]) if _index(n) == _COMMANDED), name)
            raise MalformedLog(
                f"{file}: both '{new[column]}' and '{name}' could be the {column}, choose with --map {column}='{best}'."
            )
        new[column] = name
    return new
