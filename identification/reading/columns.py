"""Convert a table's columns to the recordings of the log contract: names, units, scales, gears, runs."""

from __future__ import annotations

import shlex
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.log_columns import COMMANDS
from identification.reading.cell_values import numbers_of
from identification.reading.clocks import on_one_clock
from identification.reading.command import Command, command_of, with_motor_torques
from identification.reading.headings import heading
from identification.reading.inventory import refuse_missing
from identification.reading.joints import select_joint
from identification.reading.reading_options import Reading
from identification.reading.recognition import Recognition, recognise
from identification.reading.runs import labels_of, split_runs
from identification.reading.sign_bit import signed
from identification.reading.stated_units import stated_units
from identification.reading.table import Table
from identification.reading.time_stamps import seconds_of, with_whole_stamps
from identification.reading.units import kind_of, si_factor, si_unit
from identification.recording import Array, Recording, Response
from plant.effects import catalogue
from plant.errors import BadParameter

_BARE = ("time", "duty", "run")  # without a unit, or with one that is recognised from the numbers
_STATED = {
    **{name: name for name in ("time", "velocity")},
    **dict.fromkeys(("angle", "position"), "output"),
    **{name: "command" for name in COMMANDS if name != "setpoint"},
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Recorded:
    """Recordings of one table, with axis and unit of the command.

    notes: limitations of a result, such as an unknown scale; warnings: findings, skipped parts and assumptions.
    """

    recordings: tuple[Recording, ...]
    axis: str
    command_unit: str
    notes: tuple[str, ...]
    warnings: tuple[str, ...]


def read_recordings(table: Table, reading: Reading) -> Recorded:
    """One `Recording` for each run of the table.

    Raises `MissingColumns` if the time, the command or the response is not recognised, `MalformedLog` for columns
    that do not fit together or have no numbers, `BadParameter` for options that do not fit.
    """
    table = select_joint(table, reading.joint, mapped=list(reading.mapping.values()))
    table = with_whole_stamps(table)
    known = recognise(table, reading)
    refuse_missing(table, known, reading)
    table, found = on_one_clock(table, known.found)
    counted = "time" not in found
    if counted:
        table, found = _counted(table, found, float(reading.rate or 1.0))
    elif reading.rate is not None:
        raise BadParameter(f"{table.name} has times (column '{found['time']}'); leave the rate out.")
    axis = _axis(table, found, reading)
    for option in (reading.units, reading.scales):
        for column in option:
            if column not in found:
                raise BadParameter(f"'{column}' is given a unit or scale, but {table.name} has no such column; map it.")
    stated = stated_units(table, found, known.objects, units=reading.units, scales=reading.scales, axis=axis)
    found = {column: name for column, name in found.items() if column not in stated.left_out}
    channels, of_values = _channels(table, found, reading, stated.units, axis)
    kept, rows = _rows_with_numbers(table, channels)
    channels = {column: values[kept] for column, values in channels.items()}
    command = command_of(table.name, found, channels, axis, reading)
    channels = with_motor_torques(channels, reading)
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
        stated=frozenset(
            {_STATED[column] for column in stated.units if column in _STATED} | ({"rate"} if counted else set())
        ),
        others={name: v for name, v in channels.items() if name not in ("time", "torque", "force", output)},
    )
    labels = labels_of(table, found["run"])[kept] if "run" in found else None
    recordings, of_order = split_runs(whole, labels)
    return Recorded(
        recordings=recordings,
        axis=axis,
        command_unit=command.unit,
        notes=notes,
        warnings=(
            *table.notes,
            *_by_meaning(table, known, found, {*stated.units, *reading.scales}, axis),
            *stated.notes,
            *of_values,
            *of_order,
        ),
    )


def _by_meaning(
    table: Table, known: Recognition, found: Mapping[str, str], sized: Collection[str], axis: str
) -> tuple[str, ...]:
    """A sentence on the columns that were recognised by a similar name, and the assumed units."""
    listed = [
        f"'{name}' as {column}" + ("" if column in sized or column in _BARE else f" in {si_unit(column, axis)}")
        for column, name in found.items()
        if known.why.get(column, "").startswith(("by name", "a torque", "an angle"))
    ]
    return (f"{table.name}: recognised by name: {', '.join(listed)}",) if listed else ()


def _counted(table: Table, found: Mapping[str, str], rate: float) -> tuple[Table, dict[str, str]]:
    """The table with a time from its row numbers and the rate."""
    length = len(next(iter(table.columns[name] for name in found.values())))
    name = next(name for name in ("time", "time of the rows") if name not in table.columns)
    columns = {**table.columns, name: np.arange(length) / rate}
    return replace(table, columns=columns), {**found, "time": name}


def _channels(
    table: Table, found: Mapping[str, str], reading: Reading, units: Mapping[str, str], axis: str
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """The columns as numbers in SI, without the labels of the runs, and notes on times and signs."""
    channels: dict[str, Array] = {}
    notes: list[str] = []
    for column, name in found.items():
        if column == "run":
            continue
        factor = float(reading.scales.get(column, 1.0))
        factor *= si_factor(column, units[column], axis) if column in units else 1.0
        if column == "time":
            sized = column in units or column in reading.scales
            channels[column], of_time = seconds_of(table, name, factor if sized else None)
            notes += of_time
        else:
            values, stored = signed(numbers_of(table, name, column))
            channels[column] = values * factor
            if stored:
                notes.append(f"{table.name}: '{name}' {stored}, and is read so")
    _same_length(table, found, channels)
    return channels, tuple(notes)


def _rows_with_numbers(table: Table, channels: Mapping[str, Array]) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """(T,) whether any channel has a number, and the row numbers of these rows in the file, counted from 1."""
    kept = ~np.all([np.isnan(values) for values in channels.values()], axis=0)
    if not kept.any():
        raise MalformedLog(f"{table.name}: there are no rows with numbers, export the log again.")
    rows = np.arange(1, kept.size + 1) if table.rows is None else table.rows
    return kept, rows[kept]


def _axis(table: Table, found: Mapping[str, str], reading: Reading) -> str:
    """The axis from the output; for a velocity alone from its unit or from the command."""
    rotary, linear = "angle" in found, "position" in found
    if not rotary and not linear:
        unit = (
            reading.units.get("velocity") or table.units.get(found["velocity"], "") or heading(found["velocity"]).unit
        )
        linear = "force" in found or kind_of(unit) == "m/s"
        rotary = not linear
    if rotary and linear:
        raise MalformedLog(
            f"{table.name}: '{found['angle']}' is an angle and '{found['position']}' a position; say which is the "
            f"response, --map angle={shlex.quote(found['angle'])} or --map angle={shlex.quote(found['position'])}."
        )
    wrong = "force" if rotary else "torque"
    if wrong in found:
        raise MalformedLog(
            f"{table.name}: '{wrong}' does not go with '{'angle' if rotary else 'position'}'; a rotary axis has "
            "torque and angle, a linear one force and position."
        )
    return "rotary" if rotary else "linear"


def _without_angle(table: Table, name: str, response: Response, command: Command) -> tuple[str, ...]:
    """The note on a log of the velocity alone.

    Raises `MalformedLog` if the command needs the angle.
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


def _same_length(table: Table, found: Mapping[str, str], channels: Mapping[str, Array]) -> None:
    samples = len(channels["time"])
    for column, name in found.items():
        length = len(channels[column] if column in channels else table.columns[name])
        if length != samples:
            raise MalformedLog(
                f"{table.name}: the column '{name}' has {length} samples, but the time has {samples}; "
                "export both at the same rate."
            )
