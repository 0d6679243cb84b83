"""Traces of CODESYS, as its trace editor saves them (also ctrlX, and others built on CODESYS): key and value lines.

A header of `key; value`, then for each variable N its keys (`0.Variable; Main.position`) and below `0.Data;` its
samples, `; time; value`, at times of its own. The time is a whole number of milliseconds or microseconds, whichever
`Flags` says.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.reading.table import Table

_HEADER = re.compile(r"\s*\[key\]\s*;\s*\[value\]\s*$", re.IGNORECASE)
_VARIABLE = re.compile(r"\s*(\d+)\.Variable\s*;(.*)$")
_KEY = re.compile(r"\s*(\d+\.)?\w[\w.]*\s*;")
_SEARCHED_LINES = 200
_UNITS = {16: "ms", 32: "us"}  # bits of `Flags`
_TRUTH = {"TRUE": 1.0, "FALSE": 0.0}


@dataclass(kw_only=True)
class _Variable:
    name: str
    times: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)


def is_trace(lines: Sequence[str]) -> bool:
    """Whether the lines of a file are such a trace."""
    return bool(lines and _HEADER.match(lines[0])) or any(map(_VARIABLE.match, lines[:_SEARCHED_LINES]))


def read_trace(lines: Sequence[str], name: str, sha256: str) -> Table:
    """The variables of a trace, each on its clock.

    Raises `MalformedLog` where a line is neither a key nor a sample, or no variable has samples.
    """
    variables: list[_Variable] = []
    flags = 0
    cut = ""
    for number, line in enumerate(lines, 1):
        if line.lstrip().startswith(";"):
            try:
                _add(line, variables)
            except ValueError as error:
                if number == len(lines):
                    cut = f"{name}: the last line ({number}) is cut off and left out"
                    continue
                raise MalformedLog(
                    f"{name}, line {number}: {line.strip()[:40]!r} is no sample of a trace ('; time; value'), "
                    "repair or delete this line."
                ) from error
        elif found := _VARIABLE.match(line):
            variables.append(_Variable(name=found[2].strip()))
        elif line.split(";")[0].strip() == "Flags":
            flags = _whole(line)
        elif line.strip() and not _KEY.match(line) and not _HEADER.match(line) and number < len(lines):
            raise MalformedLog(f"{name}, line {number}: this is no line of a CODESYS trace, save the trace again.")
    unit, notes = _unit(flags, variables, name)
    kept = [variable for variable in variables if len(variable.times) > 1]
    if not kept:
        raise MalformedLog(f"{name}: the trace holds no samples, save it again after it has recorded.")
    return _table(kept, unit, name, sha256, (*notes, *[cut] * bool(cut)))


def _add(line: str, variables: list[_Variable]) -> None:
    """One sample to the variable it stands below; raises `ValueError` where it is none."""
    _, stamp, value = line.split(";", 2)
    text = value.strip()
    if not variables:
        raise ValueError(line)
    number = _TRUTH.get(text.upper())
    time = float(stamp)
    variables[-1].values.append(float(text.replace(",", ".")) if number is None else number)
    variables[-1].times.append(time)


def _whole(line: str) -> int:
    try:
        return int(line.split(";")[1].strip(), 0)
    except ValueError:
        return 0


def _unit(flags: int, variables: Sequence[_Variable], name: str) -> tuple[str, tuple[str, ...]]:
    """The unit of the time, and a word where the file does not tell it."""
    told = [unit for bit, unit in _UNITS.items() if flags & bit]
    if len(told) == 1 or not variables:
        return (told or ["ms"])[0], ()
    return "ms", (
        f"{name}: the trace does not say whether its times are milliseconds or microseconds (Flags {flags}), and they "
        "are taken for milliseconds; give --unit time=us otherwise",
    )


def _table(variables: Sequence[_Variable], unit: str, name: str, sha256: str, notes: tuple[str, ...]) -> Table:
    columns: dict[str, NDArray[np.float64]] = {}
    clocks: dict[str, NDArray[np.float64]] = {}
    clock: NDArray[np.float64] = np.empty(0)
    for variable in variables:
        if variable.name in columns:
            continue
        times = np.asarray(variable.times)
        clock = clock if np.array_equal(clock, times) else times
        columns[variable.name] = np.asarray(variable.values)
        clocks[variable.name] = clock
    return Table(name=name, columns=columns, sha256=sha256, notes=notes, clocks=clocks, units={"time": unit})
