"""Exports of oscilloscopes whose table is not one: Rigol counts the samples, Tektronix writes its settings beside them.

Rigol (DS1000Z and others) has the columns `X, CH1, ..., Start, Increment`, with the start and the increment of the time
in the row of units. Tektronix (TDS and TBS, a file for each channel) has keys and values of the settings in the first
columns, and time and voltage in the fourth and fifth. Other oscilloscopes write a table with a time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from identification.reading.formats.layout import Layout

_KEYS = 40  # lines in which Tektronix writes settings
_TIME, _VALUE = 3, 4  # columns of Tektronix


def oscilloscope(lines: Sequence[str]) -> tuple[list[str], Layout] | None:
    """The lines as a table with a time, and its layout; None of any other file. Line numbers stay."""
    return _rigol(lines) or _tektronix(lines)


def _rigol(lines: Sequence[str]) -> tuple[list[str], Layout] | None:
    names, units = (_cells(line) for line in (*lines[:2], "", "")[:2])
    if len(names) < 4 or (names[0], *names[-2:]) != ("X", "Start", "Increment") or len(units) != len(names):
        return None
    start, step = _number(units[-2]), _number(units[-1])
    if not (math.isfinite(start) and step > 0.0):
        return None
    channels = len(names) - 3
    table = list(lines)
    for place in range(2, len(table)):
        count, *values = table[place].split(",")
        if math.isfinite(at := _number(count)):
            table[place] = ",".join([f"{start + step * at:.12g}", *values[:channels]])
    return table, Layout(separator=",", names=("Time", *names[1:-2]), units=("s", *units[1:-2]), start=2)


def _tektronix(lines: Sequence[str]) -> tuple[list[str], Layout] | None:
    if not lines or not lines[0].startswith("Record Length,"):
        return None
    first = lines[0].split(",")
    if len(first) <= _VALUE or not (math.isfinite(_number(first[_TIME])) and math.isfinite(_number(first[_VALUE]))):
        return None
    settings = {key.strip(): value.strip() for key, value, *_ in (f"{line},,".split(",") for line in lines[:_KEYS])}
    table = [",".join(cell.strip() for cell in line.split(",")[_TIME : _VALUE + 1]) for line in lines]
    names, units = ("TIME", settings.get("Source") or "CH1"), ("s", settings.get("Vertical Units", ""))
    return table, Layout(separator=",", names=names, units=units, start=0)


def _cells(line: str) -> list[str]:
    """The cells of a line, without empty ones at its end."""
    cells = [cell.strip() for cell in line.split(",")]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
