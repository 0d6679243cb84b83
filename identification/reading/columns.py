"""From a table's columns to the recordings of the log contract: names, units, scales, gears, runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.reading.cia402 import find_objects
from identification.reading.clocks import on_one_clock
from identification.reading.stated_units import stated_units
from identification.reading.table import Table
from identification.reading.units import si_factor
from identification.recording import Array, Recording
from plant.errors import BadParameter

# The columns that a log may have; anything else in a file is left alone.
COLUMNS = (
    *("time", "torque", "torque_1", "torque_2", "force", "angle", "position"),
    *("velocity", "angle_1", "angle_2", "reference", "goal", "run"),
)


class Gears(Protocol):
    """What a log needs to know of a gear train."""

    @property
    def torque_map(self) -> Array:
        """(2,) follower torque per pinion torque (paper eq. 2)."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How a file's columns become the contract's columns.

    mapping: contract column -> the file's name for it.
    units: contract column -> the unit that its (scaled) values are in.
    scales: contract column -> factor on the file's values, applied before the unit.
    gears: needed when only the pinion torques were logged.
    """

    mapping: Mapping[str, str]
    units: Mapping[str, str]
    scales: Mapping[str, float]
    gears: Gears | None = None

    def __post_init__(self) -> None:
        """Refuse columns that no log has, and scales that are no factors."""
        for option, given in (("mapping", self.mapping), ("unit", self.units), ("scale", self.scales)):
            for column in given:
                if column not in COLUMNS or (column == "run" and option != "mapping"):
                    raise BadParameter(f"{option} for '{column}': a log has the columns {', '.join(COLUMNS)}.")
        for column, scale in self.scales.items():
            if not (isinstance(scale, int | float | np.number) and np.isfinite(scale) and scale != 0):
                raise BadParameter(f"the scale of column '{column}' is {scale!r}, give a number other than 0.")


@dataclass(frozen=True, kw_only=True, eq=False)
class Recorded:
    """Recordings of one table with what they are measured in.

    notes: what limits a result, such as an unknown scale; warnings: what was found, skipped or taken on trust.
    """

    recordings: tuple[Recording, ...]
    axis: str
    command_unit: str
    notes: tuple[str, ...]
    warnings: tuple[str, ...]


def read_recordings(table: Table, reading: Reading) -> Recorded:
    """One `Recording` for each run of the table.

    Raises `MalformedLog` for missing or non-numeric columns, `BadParameter` for options that do not fit.
    """
    found = _find_columns(table, reading.mapping)
    linear = any(
        column in given for column in ("force", "position") for given in (found, reading.units, reading.scales)
    )
    guessed = find_objects(table.name, table.columns, found, linear=linear)
    table, found = on_one_clock(table, found | guessed)
    axis = _axis(table, found)
    for option in (reading.units, reading.scales):
        for column in option:
            if column not in found:
                raise BadParameter(f"'{column}' is given a unit or scale, but {table.name} has no such column; map it.")
    stated = stated_units(table, found, guessed, units=reading.units, scales=reading.scales, axis=axis)
    found = {column: name for column, name in found.items() if column not in stated.left_out}
    channels = {}
    for column, name in found.items():
        values = _numbers(table, name, column)
        if column in reading.scales:
            values = values * float(reading.scales[column])
        if column in stated.units:
            values = values * si_factor(column, stated.units[column], axis)
        channels[column] = values
    _same_length(table, found, channels)
    kept = ~np.all([np.isnan(values) for column, values in channels.items() if column != "run"], axis=0)
    rows = np.flatnonzero(kept) + 1 if table.rows is None else table.rows[kept]
    channels = {column: values[kept] for column, values in channels.items()}
    if len(rows) == 0:
        raise MalformedLog(f"{table.name}: there are no rows with numbers, export the log again.")
    command, gain, command_name, unit, notes = _command(table, found, channels, axis, reading.gears)
    output = "angle" if axis == "rotary" else "position"
    whole = Recording(
        label=table.name,
        number=0,
        time=channels["time"],
        command=command,
        output=channels[output],
        servo_gain=gain,
        valid=np.ones(len(rows), dtype=bool),
        rows=rows,
        axis=axis,
        first_line=table.first_line,
        names={**found, "command": command_name, "output": found[output]},
        others={name: v for name, v in channels.items() if name not in ("time", "torque", "force", output, "run")},
    )
    return Recorded(
        recordings=_runs(whole, channels.get("run")),
        axis=axis,
        command_unit=unit,
        notes=notes,
        warnings=table.notes + stated.notes,
    )


def _find_columns(table: Table, mapping: Mapping[str, str]) -> dict[str, str]:
    """Contract column -> the table's column: as mapped, else by its own name, else the same in other case."""
    found = {}
    lower = {name.lower(): name for name in reversed(list(table.columns))}
    for column in COLUMNS:
        if column in mapping:
            if mapping[column] not in table.columns:
                raise MalformedLog(
                    f"{table.name}: there is no column '{mapping[column]}' to use as '{column}', "
                    f"the file has {_listed(table.columns)}."
                )
            found[column] = mapping[column]
        elif column in table.columns:
            found[column] = column
        elif column in lower and lower[column] not in mapping.values():
            found[column] = lower[column]
    return found


def _axis(table: Table, found: Mapping[str, str]) -> str:
    rotary, linear = "angle" in found, "position" in found
    if rotary and linear:
        raise MalformedLog(f"{table.name}: both an angle and a position are given, leave out one of them.")
    if not rotary and not linear:
        raise _missing(table, "angle", "the column 'angle' (or 'position' on a linear axis)")
    if "time" not in found:
        raise _missing(table, "time", "the column 'time'")
    wrong = ("force",) if rotary else ("torque", "torque_1", "torque_2")
    for column in wrong:
        if column in found:
            raise MalformedLog(
                f"{table.name}: '{column}' does not go with '{'angle' if rotary else 'position'}'; a rotary axis has "
                "torque and angle, a linear one force and position."
            )
    return "rotary" if rotary else "linear"


def _missing(table: Table, column: str, what: str) -> MalformedLog:
    guess = get_close_matches(column, table.columns, n=1, cutoff=0.4)
    example = guess[0] if guess else "NAME"
    return MalformedLog(
        f"{table.name}: {what} is missing, the file has {_listed(table.columns)}; "
        f"name it with --map {column}={example}."
    )


def _listed(names: Mapping[str, Any]) -> str:
    listed = [f"'{name}'" for name in names]
    return ", ".join(listed[:12]) + (f" and {len(listed) - 12} more" if len(listed) > 12 else "")


def _numbers(table: Table, name: str, column: str) -> Array:
    """The column as floats; dates become seconds from the first one."""
    raw: NDArray[Any] = np.asarray(table.columns[name])
    if raw.ndim != 1:
        raise MalformedLog(
            f"{table.name}: the column '{name}' has shape {raw.shape}, give one number for each sample of '{column}'."
        )
    if raw.dtype.kind in "fiub":
        return raw.astype(np.float64)
    import pandas as pd

    if column == "time":
        try:
            stamps = pd.to_datetime(pd.Series(raw), format="ISO8601" if raw.dtype.kind in "OUT" else None)
        except (ValueError, TypeError, OverflowError):
            stamps = pd.Series(raw)
        if stamps.dtype.kind == "M":
            return np.asarray((stamps - stamps.iloc[0]).dt.total_seconds(), dtype=np.float64)
    if raw.dtype.kind == "m":
        return np.asarray(raw / np.timedelta64(1, "ns"), dtype=np.float64) * 1e-9
    try:
        numbers = np.asarray(pd.to_numeric(pd.Series(raw), errors="coerce"))
    except (ValueError, TypeError):  # cells that are lists, records, ...
        numbers = np.asarray([None])
    if numbers.dtype.kind not in "fiub" or raw.dtype.kind in "M":
        raise MalformedLog(f"{table.name}: the column '{name}' does not hold plain numbers, export it again.")
    numbers = numbers.astype(np.float64)
    bad = np.flatnonzero(np.isnan(numbers) & ~np.asarray(pd.isna(pd.Series(raw))))
    if len(bad):
        row = int(bad[0])
        raise MalformedLog(
            f"{table.where(row)}, column '{name}': {str(raw[row])[:30]!r} is not a number, repair or delete this row."
        )
    return numbers


def _same_length(table: Table, found: Mapping[str, str], channels: Mapping[str, Array]) -> None:
    samples = len(channels["time"])
    for column, values in channels.items():
        if len(values) != samples:
            raise MalformedLog(
                f"{table.name}: the column '{found[column]}' has {len(values)} samples, but the time has {samples}; "
                "export both at the same rate."
            )


def _command(
    table: Table, found: Mapping[str, str], channels: Mapping[str, Array], axis: str, gears: Gears | None
) -> tuple[Array, Array, str, str, tuple[str, ...]]:
    """Command, servo gain, the command's name, its unit and notes."""
    direct = "torque" if axis == "rotary" else "force"
    unit = "N m" if axis == "rotary" else "N"
    none = np.zeros(len(channels["time"]))
    if direct in channels:
        return channels[direct], none, found[direct], unit, ()
    if "torque_1" in channels and "torque_2" in channels:
        if gears is None:
            raise MalformedLog(
                f"{table.name}: the torques of two pinions need the gear train to become the follower's torque; "
                "give its tooth counts, or a column 'torque'."
            )
        first, second = np.asarray(gears.torque_map, dtype=np.float64)  # tau_f = -(Nf/N1) xi1 - (Nf/N2) xi2, eq. (2)
        follower = first * channels["torque_1"] + second * channels["torque_2"]
        return follower, none, f"{found['torque_1']}, {found['torque_2']}", unit, ()
    if "goal" in channels:
        note = f"torque scale unknown: {table.name} has a goal but no {direct}, so torques are per radian of goal error"
        note = note if axis == "rotary" else note.replace("torques are per radian", "forces are per metre")
        return channels["goal"], none + 1.0, found["goal"], "unknown", (note,)
    raise _missing(table, direct, f"the column '{direct}' (or 'torque_1' and 'torque_2', or 'goal')")


def _runs(whole: Recording, run: Array | None) -> tuple[Recording, ...]:
    """One recording for each value of the run column, in the order in which they come."""
    if run is None:
        return (whole,)
    odd = np.flatnonzero(~(np.isfinite(run) & (np.abs(run) < 2**31)) | (np.nan_to_num(run) % 1 != 0))
    if len(odd):
        raise MalformedLog(f"{whole.where(int(odd[0]))}: the run is {run[odd[0]]:g}, number the runs 0, 1, 2, ...")
    numbers, first = np.unique(run, return_index=True)
    return tuple(
        replace(whole.take(run == number, label=f"{whole.label} run {int(number)}"), number=int(number))
        for number in numbers[np.argsort(first)]
    )
