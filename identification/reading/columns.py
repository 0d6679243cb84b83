"""From a table's columns to the recordings of the log contract: names, units, scales, gears, runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np

from identification.errors import MalformedLog
from identification.reading.cia402 import find_objects
from identification.reading.clocks import on_one_clock
from identification.reading.command import Command, command_of
from identification.reading.request import ALIASES, COLUMNS, Reading
from identification.reading.runs import split_runs
from identification.reading.stated_units import stated_units
from identification.reading.table import Table
from identification.reading.units import si_factor
from identification.reading.values import numbers_of
from identification.recording import Array, Recording, Response
from plant.effects import catalogue
from plant.errors import BadParameter


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
    axis = _axis(table, found, mapped="velocity" in reading.mapping)
    for option in (reading.units, reading.scales):
        for column in option:
            if column not in found:
                raise BadParameter(f"'{column}' is given a unit or scale, but {table.name} has no such column; map it.")
    stated = stated_units(table, found, guessed, units=reading.units, scales=reading.scales, axis=axis)
    found = {column: name for column, name in found.items() if column not in stated.left_out}
    channels = {}
    for column, name in found.items():
        values = numbers_of(table, name, column)
        if column in reading.scales:
            values = values * float(reading.scales[column])
        if column in stated.units:
            values = values * si_factor(column, stated.units[column], axis)
        channels[column] = values
    _same_length(table, found, channels)
    kept = ~np.all([np.isnan(values) for column, values in channels.items() if column != "run"], axis=0)
    rows = np.flatnonzero(kept) + 1
    channels = {column: values[kept] for column, values in channels.items()}
    if len(rows) == 0:
        raise MalformedLog(f"{table.name}: there are no rows with numbers, export the log again.")
    command = command_of(table.name, found, channels, axis, reading)
    if command is None:
        direct = "torque" if axis == "rotary" else "force"
        raise _missing(
            table,
            direct,
            f"the column '{direct}' (or 'torque_1' and 'torque_2', 'current', 'voltage', 'duty', or 'setpoint')",
        )
    output = "angle" if axis == "rotary" else "position"
    response: Response = "angle"
    if output not in channels:
        output = response = "velocity"
    notes = command.notes + _without_angle(table, found[output], response, command)
    whole = Recording(
        label=table.name,
        number=0,
        time=channels["time"],
        command=command.values,
        output=channels[output],
        servo_gain=command.servo_gain,
        servo_damping=command.servo_damping,
        valid=np.ones(len(rows), dtype=bool),
        rows=rows,
        axis=axis,
        response=response,
        first_line=table.first_line,
        names={**found, "command": command.name, "output": found[output]},
        others={name: v for name, v in channels.items() if name not in ("time", "torque", "force", output, "run")},
    )
    return Recorded(
        recordings=split_runs(whole, channels.get("run")),
        axis=axis,
        command_unit=command.unit,
        notes=notes,
        warnings=table.notes + stated.notes,
    )


def _find_columns(table: Table, mapping: Mapping[str, str]) -> dict[str, str]:
    """Contract column -> the table's column: as mapped, else by its own name, else the same in other case."""
    found = {}
    lower = {ALIASES.get(name.lower(), name.lower()): name for name in reversed(list(table.columns))}
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


def _axis(table: Table, found: Mapping[str, str], *, mapped: bool) -> str:
    """Of the output; a velocity takes its place if the user `mapped` it, or no column has the name of an angle."""
    rotary, linear = "angle" in found, "position" in found
    if not rotary and not linear and "velocity" in found and (mapped or not _has_angle(table)):
        linear = "force" in found
        rotary = not linear
    if rotary and linear:
        raise MalformedLog(f"{table.name}: both an angle and a position are given, leave out one of them.")
    if not rotary and not linear:
        raise _missing(table, "angle", "the column 'angle' (or 'position' on a linear axis, or 'velocity')")
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


def _has_angle(table: Table) -> bool:
    """Whether a column's name has an angle or a position in it, which the user may mean."""
    return any(word in name.lower() for name in table.columns for word in ("angle", "position"))


def _without_angle(table: Table, name: str, response: Response, command: Command) -> tuple[str, ...]:
    """What is said of a log of the velocity alone.

    Raises `MalformedLog` where the command needs the angle.
    """
    if response == "angle":
        return ()
    if command.servo_gain.any():
        raise MalformedLog(
            f"{table.name}: a set-point of the angle needs the angle, which is not among the columns; name it with "
            "--map angle=NAME, or name the torque or the current as the command."
        )
    titles = [kind.title for kind in catalogue.values() if kind.needs_angle]
    return (
        f"{table.name} has the velocity '{name}' and no angle: the model is fitted to the velocity; gravity and what "
        f"else needs the angle ({', '.join(titles)}) is left out",
    )


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


def _same_length(table: Table, found: Mapping[str, str], channels: Mapping[str, Array]) -> None:
    samples = len(channels["time"])
    for column, values in channels.items():
        if len(values) != samples:
            raise MalformedLog(
                f"{table.name}: the column '{found[column]}' has {len(values)} samples, but the time has {samples}; "
                "export both at the same rate."
            )
