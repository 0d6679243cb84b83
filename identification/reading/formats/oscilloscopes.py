"""Exports of oscilloscopes without a plain table: the time must be computed, or settings are in the same rows.

Rigol (DS and MSO) has the columns `X, CH1, ..., Start, Increment`, with the start and the increment of the time in the
row of units; `X` counts the samples, or is left out. Newer models write `CH1V, ..., t0 = -0.5, tInc = 1e-6` above the
numbers. Yokogawa (DL, DLM, SL) writes settings with a value for each trace, and blocks of samples; the time of sample n
of a block is HResolution (n - 1) + HOffset in HUnit. Tektronix (TDS and TBS, one file per channel) has keys and values
of the settings in the first columns, and time and voltage in the fourth and fifth. Other oscilloscopes write a table
with a time.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from identification.errors import MalformedLog
from identification.reading.formats.layout import Layout

_KEYS = 40  # lines that are searched for settings
_TIME, _VALUE = 3, 4  # columns of Tektronix
_CLOCK = re.compile(r"(t0|tInc)\s*=\s*([-+.\deE]+?)\s*s?")  # of a newer Rigol
_CHANNEL = re.compile(r"(CH\d+|MATH\d+)([A-Z])")  # name and unit


def oscilloscope(lines: Sequence[str], name: str) -> tuple[list[str], Layout] | None:
    """The lines as a table with a time, and its layout; None for any other file. Line numbers are unchanged.

    Raises `MalformedLog` for traces that were not sampled at the same times.
    """
    return _rigol(lines) or _new_rigol(lines) or _yokogawa(lines, name) or _tektronix(lines)


def _rigol(lines: Sequence[str]) -> tuple[list[str], Layout] | None:
    names, units = (_cells(line) for line in (*lines[:2], "", "")[:2])
    if len(names) < 3 or tuple(names[-2:]) != ("Start", "Increment") or len(units) != len(names):
        return None
    start, step = _number(units[-2]), _number(units[-1])
    if not (math.isfinite(start) and step > 0.0):
        return None
    first = int(names[0] == "X")
    channels = range(first, len(names) - 2)
    table = _counted(lines, 2, start, step, channels) if first else _timed(lines, 2, start, step, channels)
    return table, Layout(separator=",", names=("Time", *names[first:-2]), units=("s", *units[first:-2]), start=2)


def _counted(lines: Sequence[str], begin: int, start: float, step: float, columns: Sequence[int]) -> list[str]:
    """The lines with the sample count in the first cell replaced by its time."""
    table = list(lines)
    for place in range(begin, len(table)):
        count, *values = table[place].split(",")
        if math.isfinite(at := _number(count)):
            table[place] = ",".join([f"{start + step * at:.12g}", *values[: len(columns)]])
    return table


def _new_rigol(lines: Sequence[str]) -> tuple[list[str], Layout] | None:
    cells = _cells(lines[0]) if lines else []
    clock = {found[1]: found[2] for cell in cells if (found := _CLOCK.fullmatch(cell))}
    start, step = _number(clock.get("t0", "")), _number(clock.get("tInc", ""))
    if not (math.isfinite(start) and step > 0.0):
        return None
    channels = [place for place, cell in enumerate(cells) if cell and "=" not in cell]
    parts = [_CHANNEL.fullmatch(cells[place]) for place in channels]
    names = [part[1] if part else cells[place] for part, place in zip(parts, channels, strict=True)]
    table = _timed(lines, 1, start, step, channels)
    return table, Layout(
        separator=",", names=("Time", *names), units=("s", *(part[2] if part else "" for part in parts)), start=1
    )


def _yokogawa(lines: Sequence[str], name: str) -> tuple[list[str], Layout] | None:
    end = next((at for at, line in enumerate(lines[:_KEYS]) if _is_data(line)), 0)
    settings: dict[str, list[str]] = {}
    for line in lines[:end]:
        key, *values = (cell.strip().strip('"').strip() for cell in line.split(","))
        settings.setdefault(key, [value for value in values if value])
    if not {"TraceName", "HResolution", "HOffset"} <= settings.keys():
        return None
    traces = settings["TraceName"]
    for key in ("HResolution", "HOffset", "BlockSize"):
        if len(set(settings.get(key, ()))) > 1:
            raise MalformedLog(
                f"{name}: the traces differ in {key}, so they have no common time; export those of one sample rate."
            )
    start, step = (_number(next(iter(settings[key]), "")) for key in ("HOffset", "HResolution"))
    if not (traces and math.isfinite(start) and step > 0.0):
        return None
    below_keys = int(not lines[end].split(",")[0].strip())
    size = next(iter(settings.get("BlockSize", ())), "")
    columns = range(below_keys, below_keys + len(traces))
    table = _timed(lines, end, start, step, columns, block=int(size) if size.isdigit() else 0)
    units = (next(iter(settings.get("HUnit", ())), "s"), *settings.get("VUnit", ()))
    return table, Layout(separator=",", names=("Time", *traces), units=units, start=end)


def _is_data(line: str) -> bool:
    """Whether a line has numbers only."""
    cells = [cell.strip() for cell in line.split(",") if cell.strip()]
    return bool(cells) and all(math.isfinite(_number(cell)) for cell in cells)


def _timed(
    lines: Sequence[str], begin: int, start: float, step: float, columns: Sequence[int], *, block: int = 0
) -> list[str]:
    """The lines with a time before the cells of `columns`; it restarts with each `block` of samples."""
    table, count = list(lines), 0
    for place in range(begin, len(table)):
        cells = [cell.strip() for cell in table[place].split(",")]
        if any(cells):
            at = start + step * (count % block if block else count)
            table[place] = ",".join([f"{at:.12g}", *(cells[column] for column in columns if column < len(cells))])
            count += 1
    return table


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
