"""Traces of the CODESYS trace editor (also ctrlX, and other systems based on CODESYS): lines of keys and values.

A header of `key; value`, then for each variable N its keys (`0.Variable; Main.position`) and below `0.Data;` its
samples, `; time; value`, with separate times. The time is a whole number of milliseconds or microseconds, according to
`Flags`.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.reading.table import Table
from identification.recording import Array

_HEADER = re.compile(r"\s*\[key\]\s*;\s*\[value\]\s*$", re.IGNORECASE)
_VARIABLE = re.compile(r"\s*(\d+)\.Variable\s*;(.*)$")
_KEY = re.compile(r"\s*(\d+\.)?\w[\w.]*\s*;")
_SEARCHED_LINES = 200
_UNITS = {16: "ms", 32: "us"}  # bits of `Flags`
_TRUTH = {"TRUE": 1.0, "FALSE": 0.0}


@dataclass(kw_only=True)
class _Variable:
    name: str
    times: list[Array] = field(default_factory=list)
    values: list[Array] = field(default_factory=list)


def is_trace(lines: Sequence[str]) -> bool:
    """Whether the lines of a file are a trace of CODESYS."""
    return bool(lines and _HEADER.match(lines[0])) or any(map(_VARIABLE.match, lines[:_SEARCHED_LINES]))


def read_trace(lines: Sequence[str], name: str, sha256: str) -> Table:
    """The variables of a trace, each on its clock.

    Raises `MalformedLog` if a line is neither a key nor a sample, or no variable has samples.
    """
    variables: list[_Variable] = []
    flags = 0
    notes: tuple[str, ...] = ()
    keys = [k for k, line in enumerate(lines) if (text := line.strip()) and text[0] != ";"]
    for key, end in zip([-1, *keys], [*keys, len(lines)], strict=True):
        line = lines[key] if key >= 0 else ""
        if found := _VARIABLE.match(line):
            variables.append(_Variable(name=found[2].strip()))
        elif line.split(";")[0].strip() == "Flags":
            flags = _whole(line)
        elif line.strip() and not _KEY.match(line) and not _HEADER.match(line) and key + 1 < len(lines):
            raise MalformedLog(f"{name}, line {key + 1}: this is no line of a CODESYS trace, save the trace again.")
        if any(map(str.strip, lines[key + 1 : end])):
            if not variables:
                raise _no_sample(lines, key + 1, name)
            times, values, cut = _samples(lines, key + 1, end, name)
            variables[-1].times.append(times)
            variables[-1].values.append(values)
            notes += (f"{name}: the last line ({len(lines)}) is cut off and left out",) * cut
    unit, unit_notes = _unit(flags, variables, name)
    kept = [variable for variable in variables if sum(map(len, variable.times)) > 1]
    if not kept:
        raise MalformedLog(f"{name}: the trace holds no samples, save it again after it has recorded.")
    return _table(kept, unit, name, sha256, (*unit_notes, *notes))


def _samples(lines: Sequence[str], start: int, end: int, name: str) -> tuple[Array, Array, bool]:
    """Times and values in a block of lines, and whether the last line of the file is cut off and left out."""
    import pandas as pd

    kept = [k for k in range(start, end) if lines[k].strip()]
    try:
        frame = pd.read_csv(
            io.StringIO("\n".join(lines[start:end])), sep=";", header=None, names=range(3), skipinitialspace=True
        )
        times, values = frame[1].to_numpy(), frame[2].to_numpy()
        if times.dtype.kind in "fi" and values.dtype.kind in "fib" and len(times) == len(kept):
            times, values = times.astype(np.float64), values.astype(np.float64)
            if np.isfinite(times).all() and not np.isnan(values).any():
                return times, values, False
    except Exception:  # from a damaged line, handled below
        pass
    pairs = []
    for k in kept:  # one by one, to find the wrong line
        try:
            pairs.append(_sample(lines[k]))
        except ValueError as error:
            if k + 1 < len(lines):
                raise _no_sample(lines, k, name) from error
    both = np.asarray(pairs, dtype=np.float64).reshape(-1, 2)
    return both[:, 0], both[:, 1], len(pairs) < len(kept)


def _sample(line: str) -> tuple[float, float]:
    """Time and value of a line; raises `ValueError` without them."""
    _, stamp, value = line.split(";", 2)
    text = value.strip()
    number = _TRUTH.get(text.upper())
    return float(stamp), float(text.replace(",", ".")) if number is None else number


def _no_sample(lines: Sequence[str], index: int, name: str) -> MalformedLog:
    return MalformedLog(
        f"{name}, line {index + 1}: {lines[index].strip()[:40]!r} is no sample of a trace ('; time; value'), "
        "repair or delete this line."
    )


def _whole(line: str) -> int:
    try:
        return int(line.split(";")[1].strip(), 0)
    except ValueError:
        return 0


def _unit(flags: int, variables: Sequence[_Variable], name: str) -> tuple[str, tuple[str, ...]]:
    """The unit of the time, and a note if the file does not have it."""
    units = [unit for bit, unit in _UNITS.items() if flags & bit]
    if len(units) == 1 or not variables:
        return (units or ["ms"])[0], ()
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
        times = np.concatenate(variable.times)
        clock = clock if np.array_equal(clock, times) else times
        columns[variable.name] = np.concatenate(variable.values)
        clocks[variable.name] = clock
    return Table(name=name, columns=columns, sha256=sha256, notes=notes, clocks=clocks, units={"time": unit})
