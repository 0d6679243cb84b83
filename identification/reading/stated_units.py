"""The unit of each column of a log: from the user, else from the file, else SI.

SI is not assumed for values in units of the drive (CiA 402), or if the unit in the file has no fixed size.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from identification.errors import MalformedLog
from identification.reading.cia402 import drive_object
from identification.reading.formats.unit_row import NO_UNIT
from identification.reading.headings import heading
from identification.reading.table import Table
from identification.reading.units import kind_of, si_factor, si_unit
from plant.errors import BadParameter

_DISPENSABLE = ("velocity", "angle_1", "angle_2", "reference")  # optional columns of a log


@dataclass(frozen=True, kw_only=True)
class StatedUnits:
    """Contract column -> unit; columns that are left out because the size of their unit is unknown; notes."""

    units: dict[str, str]
    left_out: tuple[str, ...]
    notes: tuple[str, ...]


def stated_units(
    table: Table,
    found: Mapping[str, str],
    guessed: Collection[str],
    *,
    units: Mapping[str, str],
    scales: Mapping[str, float],
    axis: str,
) -> StatedUnits:
    """The units of the columns in `found` (contract column -> the table's); `guessed` were found as objects of CiA 402.

    Raises `BadParameter` if a scale and the file's unit contradict each other, and `MalformedLog` if a required column
    has a unit of unknown size.
    """
    known = dict(units)
    stated = []
    left_out = []
    notes = []
    for column, name in found.items():
        if column in units or column == "run":
            continue
        unit = table.units.get(name, "").strip() or _of_heading(name, column, axis)
        _refuse_set_point_of_speed(table, column, name)
        try:
            if unit.lower() not in NO_UNIT:
                if _counts(column, unit, axis, scaled=column in scales):
                    known[column] = unit
                    stated.append(f"'{name}' in {unit}")
            elif column not in scales:
                _refuse_increments(table, column, name, axis, guessed=column in guessed)
        except MalformedLog as error:
            if column not in _DISPENSABLE or not {"angle", "position"} & set(found):  # a velocity may be the response
                raise MalformedLog(f"{table.name}: {error}") from error
            left_out.append(column)
            notes.append(f"{table.name}: '{name}' is left out, as {str(error).rstrip('.')}")
    if guessed:
        listed = ", ".join(f"'{found[column]}' as {column}" for column in guessed if column not in left_out)
        notes.append(f"{table.name}: recognised as objects of CiA 402: {listed}")
    if stated:
        notes.append(f"{table.name}: units from the file: {', '.join(stated)}")
    return StatedUnits(units=known, left_out=tuple(left_out), notes=tuple(notes))


def _of_heading(name: str, column: str, axis: str) -> str:
    """The unit in a heading; a last word such as the m of `theta_m` counts only if it is of the column's kind."""
    read = heading(name)
    return "" if read.trailing and kind_of(read.unit) != si_unit(column, axis) else read.unit


def _counts(column: str, unit: str, axis: str, *, scaled: bool) -> bool:
    """Whether the file's unit is used. A scale replaces a unit that cannot be converted (ampere to N m)."""
    try:
        factor = si_factor(column, unit, axis)
    except BadParameter as error:
        if scaled:
            return False
        raise MalformedLog(str(error)) from error
    if scaled and factor != 1.0:
        raise BadParameter(
            f"'{column}' is given a scale and the file says that it is in '{unit}': add --unit {column}='{unit}' if "
            f"the scale comes on top of that, or --unit {column}='{si_unit(column, axis)}' if it takes its place."
        )
    return True


def _refuse_set_point_of_speed(table: Table, column: str, name: str) -> None:
    """Raise `MalformedLog` for a set-point in a unit of speed: a position servo follows a position."""
    if column == "setpoint" and kind_of(table.units.get(name, "").strip() or heading(name).unit) in ("rad/s", "m/s"):
        raise MalformedLog(
            f"{table.name}: '{name}' is the set-point of a speed, and a position servo follows that of its position; "
            "name the torque, the current, the voltage or the duty of the drive, for example --map current=NAME."
        )


def _refuse_increments(table: Table, column: str, name: str, axis: str, *, guessed: bool) -> None:
    """Raise `MalformedLog` for an object in increments; for one that the user mapped only if it has whole numbers."""
    known = drive_object(name)
    if known is None:
        return
    values = np.asarray(table.columns[name])
    if values.dtype.kind not in "fiu" or np.any(values[np.isfinite(values)] % 1 != 0):
        if not guessed:
            return
        raise MalformedLog(
            f"'{name}' is called like an object of CiA 402 ({known.index.upper()}h), but has no whole numbers: give "
            f"its unit, for example --unit {column}='{si_unit(column, axis)}', or say what it is with --map."
        )
    raise MalformedLog(
        f"'{name}' ({known.index.upper()}h) is in {known.counted_in}: give the size of one, for example "
        f"--unit {column}={known.units[axis == 'linear']}, or --unit {column}='{si_unit(column, axis)}' if it is in SI."
    )
