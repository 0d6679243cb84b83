"""Files of one experiment, such as the drive's and the encoder's, joined on their clocks, or row by row without one."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.reading.column_meaning import is_time, time_unit
from identification.reading.table import Table
from identification.reading.time_stamps import clock_of, with_whole_stamps
from identification.reading.units import si_factor
from identification.recording import Array

_FIRST_DATE = 1e8  # [s]; a larger time counts from 1970 or another date


def qualified(table: Table, name: str) -> str:
    """The name of a column with the name of its file before it, `encoder/position`."""
    return f"{Path(table.name).stem}/{name}"


def join_tables(tables: Sequence[Table], time: str | None = None, wanted: Collection[str] = ()) -> Table:
    """One table of all columns, each on the clock of its file [s].

    A name that occurs in two files, or is `wanted` so, is prefixed by the name of the file, `encoder/position`. `time`
    is the column of the time if its name is not recognised; it is not needed for a file with a clock per channel.

    Raises `MalformedLog` if a file has no time, or the times do not overlap.
    """
    _refuse_one_name(tables)
    clocked = [_clocked(table, time) for table in tables]
    spans = [_span(table, clocks) for table, (_, clocks) in zip(tables, clocked, strict=True)]
    begin, end = max(first for first, _ in spans), min(last for _, last in spans)
    if not begin < end:
        listed = " and ".join(
            f"{table.name} runs from {first:.10g} s to {last:.10g} s"
            for table, (first, last) in zip(tables, spans, strict=True)
        )
        raise MalformedLog(f"the clocks of the files do not overlap: {listed}; shift the time of one of them.")
    start = min(first for first, _ in spans)
    times = Counter(name for columns, _ in clocked for name in columns)
    merged: dict[str, NDArray[Any]] = {}
    clocks: dict[str, NDArray[Any]] = {}
    units: dict[str, str] = {"time": "s"}
    joint_of: dict[str, tuple[str, str]] = {}
    for table, (columns, own) in zip(tables, clocked, strict=True):
        shifted = {id(clock): clock - start for clock in own.values()}  # channels of one clock still share it
        for name, values in columns.items():
            called = _called(table, name, times, wanted)
            merged[called], clocks[called] = values, shifted[id(own[name])]
            if name in table.units:
                units[called] = table.units[name]
            if name in table.joint_of:
                joint_of[called] = table.joint_of[name]
    names = " and ".join(table.name for table in tables)
    note = f"{names}: joined on their clocks, which have {end - begin:.4g} s in common"
    if begin < _FIRST_DATE:
        note += "; their zeros are taken to be the same instant"
    return Table(
        name=" + ".join(table.name for table in tables),
        columns=merged,
        sha256=_digest(tables),
        notes=(*(note for table in tables for note in table.notes), note),
        clocks=clocks,
        units=units,
        joint_of=joint_of,
    )


def join_rows(tables: Sequence[Table], wanted: Collection[str] = ()) -> Table:
    """One table of all columns of files without a clock, row by row; names as in `join_tables`.

    Raises `MalformedLog` if the files have different numbers of rows.
    """
    _refuse_one_name(tables)
    counts = [max(map(len, table.columns.values()), default=0) for table in tables]
    names = " and ".join(table.name for table in tables)
    if len(set(counts)) > 1:
        raise MalformedLog(
            f"{names}: they have no common time, and {' and '.join(map(str, counts))} rows, so they cannot be joined; "
            "export them with a time or into one file."
        )
    times = Counter(name for table in tables for name in table.columns)
    merged: dict[str, NDArray[Any]] = {}
    units: dict[str, str] = {}
    joint_of: dict[str, tuple[str, str]] = {}
    for table in tables:
        called = {name: _called(table, name, times, wanted) for name in table.columns}
        merged |= {called[name]: values for name, values in table.columns.items()}
        units |= {called[name]: unit for name, unit in table.units.items() if name in called}
        joint_of |= {called[name]: joint for name, joint in table.joint_of.items()}
    return Table(
        name=" + ".join(table.name for table in tables),
        columns=merged,
        sha256=_digest(tables),
        notes=(*(note for table in tables for note in table.notes), f"{names}: joined row by row"),
        units=units,
        joint_of=joint_of,
    )


def has_clock(table: Table, time: str | None) -> bool:
    """Whether a table has a clock per channel, or a column of the time."""
    return bool(table.clocks) or time in table.columns or any(is_time(name) for name in table.columns)


def _called(table: Table, name: str, times: Counter[str], wanted: Collection[str]) -> str:
    full = qualified(table, name)
    return full if times[name] > 1 or full in wanted else name


def _refuse_one_name(tables: Sequence[Table]) -> None:
    """Raise `MalformedLog` for files of one name: their columns could not be told apart."""
    stems = Counter(Path(table.name).stem for table in tables)
    twice = next((stem for stem, count in stems.items() if count > 1), None)
    if twice is not None:
        raise MalformedLog(f"{len(tables)} files are to be joined, and two are called '{twice}'; rename one of them.")


def _digest(tables: Sequence[Table]) -> str:
    return hashlib.sha256("".join(table.sha256 for table in tables).encode()).hexdigest()


def _clocked(table: Table, time: str | None) -> tuple[dict[str, NDArray[Any]], dict[str, Array]]:
    """The columns of a table without its time, and the clock of each [s]."""
    if table.clocks:
        scale = si_factor("time", table.units.get("time", "s"), "rotary")
        shared = {id(clock): scale * np.asarray(clock, dtype=np.float64) for clock in table.clocks.values()}
        clocks = {name: shared[id(clock)] for name, clock in table.clocks.items()}
        return {name: table.columns[name] for name in clocks}, clocks
    table = with_whole_stamps(table)
    name = time if time in table.columns else next((name for name in table.columns if is_time(name)), None)
    if name is None and time is not None and ":" in time:  # columns of matrices without names: the same place
        name = next((name for name in table.columns if name.endswith(time[time.rindex(":") :])), None)
    if name is None:
        raise MalformedLog(f"{table.name}: no column is called as a time is, name it with --map time=NAME.")
    clock = _seconds(table, name)
    columns = {key: values for key, values in table.columns.items() if key != name and len(values) == len(clock)}
    known = np.isfinite(clock)
    if not known.all():
        clock, columns = clock[known], {key: values[known] for key, values in columns.items()}
    return columns, dict.fromkeys(columns, clock)


def _seconds(table: Table, name: str) -> Array:
    """A column of times in seconds: numbers by their unit, dates since 1970, times of day since midnight."""
    unit = table.units.get(name, "") or time_unit(name)
    times, begin, _ = clock_of(table, name, si_factor("time", unit, "rotary") if unit else None)
    return times + begin


def _span(table: Table, clocks: dict[str, Array]) -> tuple[float, float]:
    ends = [(clock.min(), clock.max()) for clock in clocks.values() if len(clock)]
    if not ends:
        raise MalformedLog(f"{table.name}: there is nothing beside the time, export the log again.")
    return float(min(first for first, _ in ends)), float(max(last for _, last in ends))
