"""Exports with one time column per group of channels, as from TwinCAT Scope and oscilloscopes.

With a line of names such as `Name, a, b, Name, c`, the channels a and b have the times of the first column, and c those
of the fourth. TwinCAT Scope (Beckhoff TE13xx, export in csv) repeats the key in each line of its header, for example
`SampleTime[ms]` and `Unit`; its times are milliseconds since the start, or counts of 100 ns since the year 1601.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.reading.column_meaning import is_time, time_unit

_SEARCHED_LINES = 200
_PROOF = {"SampleTime[ms]", "Starttime of export", "StartRecord"}  # only TwinCAT Scope writes these
_NEUTRAL = {"ScaleFactor": "1", "Offset": "0", "Unit ScaleFactor": "1", "Unit Offset": "0"}
_FILETIME = 1e15  # [100 ns]; in milliseconds it would be thirty thousand years
_NUMBER = re.compile(r"[+-]?\d+([.,]\d*)?([eE][+-]?\d+)?$")


@dataclass(frozen=True, kw_only=True)
class ScopeHeader:
    """Header of a TwinCAT Scope export: line of the names, first line of data, and its further lines by their key."""

    separator: str
    names_line: int
    data_line: int
    names: tuple[str, ...]
    details: dict[str, list[str]] = field(default_factory=dict)


def find_scope_header(lines: Sequence[str]) -> ScopeHeader | None:
    """The header of a TwinCAT Scope export, None for any other file."""
    if not lines or not re.match(r"Name[\t;,|]", lines[0]):
        return None
    separator = lines[0][4]
    table = [[cell.strip().strip('"') for cell in line.split(separator)] for line in lines[:_SEARCHED_LINES]]
    if not any(cells[0] in _PROOF for cells in table):
        return None
    data_line = next(
        (
            k
            for k, cells in enumerate(table)
            if len(cells) > 1 and any(cells) and all(not cell or _NUMBER.match(cell) for cell in cells)
        ),
        None,
    )
    keys = [k for k, cells in enumerate(table[:data_line]) if cells[0] == "Name"]
    if data_line is None or len(keys) < 2:  # the first such line is the scope's name, the last one has the channels
        return None
    width = len(table[keys[-1]])
    return ScopeHeader(
        separator=separator,
        names_line=keys[-1],
        data_line=data_line,
        names=tuple(table[keys[-1]]),
        details={cells[0]: cells for cells in table[keys[-1] + 1 : data_line] if len(cells) == width},
    )


def group_starts(names: Sequence[str]) -> list[int]:
    """Indices of the time columns: all with the name of the first one, if that is the name of a time or `Name`."""
    if not names or not (names[0] == "Name" or is_time(names[0])):
        return []
    return [k for k, name in enumerate(names) if name == names[0]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Groups:
    """Channels with the times of their groups, their units, and notes.

    row_by_row: whether the samples of each channel are those of the first rows, so that a sample has a line number.
    """

    columns: dict[str, NDArray[Any]]
    clocks: dict[str, NDArray[np.float64]]
    units: dict[str, str]
    notes: tuple[str, ...]
    row_by_row: bool


def read_groups(
    names: Sequence[str], frame: Sequence[NDArray[Any]], scope: ScopeHeader | None, units: Sequence[str], file: str
) -> Groups:
    """Split the columns of a table into channels with separate clocks; `units` are those of a row below the names.

    Raises `MalformedLog` if a channel has text.
    """
    try:
        numbers = [np.asarray(values, dtype=np.float64) for values in frame]
    except (ValueError, TypeError) as error:
        raise MalformedLog(f"{file}: a channel holds text among its numbers, export the log again.") from error
    columns: dict[str, NDArray[Any]] = {}
    clocks: dict[str, NDArray[np.float64]] = {}
    starts = group_starts(names)
    row_by_row = True
    dated = scope is not None and any(np.nanmax(numbers[k], initial=0.0) > _FILETIME for k in starts)
    origin = min((float(np.nanmin(numbers[k], initial=np.inf)) for k in starts), default=0.0) if dated else 0.0
    for start, end in zip(starts, [*starts[1:], len(names)], strict=True):
        stamps = (numbers[start] - origin) * 1e-4 if dated else numbers[start]
        kept = np.isfinite(stamps)
        kept[1:] &= stamps[1:] != stamps[:-1]  # a slow group may be padded by repeating its rows
        clock = stamps[kept]
        row_by_row &= bool(kept[: len(clock)].all())
        for k in range(start + 1, end):
            if names[k] and names[k] not in columns:
                columns[names[k]] = numbers[k][kept]
                clocks[names[k]] = clock
    stated = {name: unit for name, unit in zip(names, units, strict=False) if unit and name in columns}
    if clock_unit := time_unit(names[0]) or (units[0] if units else ""):
        stated["time"] = clock_unit
    scaled, notes = _units(names, scope, file)
    return Groups(columns=columns, clocks=clocks, units=stated | scaled, notes=notes, row_by_row=row_by_row)


def _units(names: Sequence[str], scope: ScopeHeader | None, file: str) -> tuple[dict[str, str], tuple[str, ...]]:
    """Units of the channels, without those scaled in the scope: the file does not say if the export is scaled."""
    if scope is None:
        return {}, ()
    units = {"time": "ms"}
    scaled = []
    for k, name in enumerate(names):
        if k in group_starts(names):
            continue
        given = {key: cells[k] for key, cells in scope.details.items()}
        unit = re.sub(r"\s*\([^)]*\)$", "", given.get("Unit", ""))  # "dV (Voltage)"
        if any(given.get(key, neutral) not in (neutral, "") for key, neutral in _NEUTRAL.items()):
            scaled.append(name)
        elif unit and name not in units:
            units[name] = unit
    if not scaled:
        return units, ()
    listed = ", ".join(f"'{name}'" for name in scaled)
    return units, (
        f"{file}: the scope has a scale or offset for {listed}, and whether the export applied it the file "
        "does not say; check the values, and give their unit with --unit",
    )
