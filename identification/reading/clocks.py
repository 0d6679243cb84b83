"""Channels with separate sampling times, resampled to the clock of the measured output."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identification.checks.timing import GAP
from identification.errors import MalformedLog
from identification.log_columns import COMMANDS
from identification.reading.runs import labels_of
from identification.reading.table import Table
from identification.recording import Array


def on_one_clock(table: Table, found: Mapping[str, str]) -> tuple[Table, dict[str, str]]:
    """The columns in `found` (contract column -> the table's) on one clock, and `found` with that clock as its time.

    The clock is that of the output, so that its samples are unchanged. The others are interpolated; but of a command
    that is sampled faster the means are used, because they have the same impulse. A time that the user mapped, or a
    column with the name of a time, has priority over the clock.

    Raises `MalformedLog` if the time of a channel does not increase, or a channel has text.
    """
    output = next((found[column] for column in ("angle", "position", "velocity") if column in found), "")
    clock = table.clocks.get(output)
    if clock is None:
        return table, dict(found)
    columns = dict(table.columns)
    moved = []
    for column, name in found.items():
        own = table.clocks.get(name)
        if own is None or own is clock or np.array_equal(own, clock):
            continue
        time = np.asarray(clock, dtype=np.float64)
        columns[name] = _labels(table, name, time) if column == "run" else _moved(table, name, time, column in COMMANDS)
        moved.append(name)
    notes = table.notes
    if moved:
        listed = ", ".join(f"'{name}'" for name in moved)
        notes += (f"{table.name}: each channel has its own time; {listed} interpolated on the time of '{output}'",)
    completed = dict(found)
    if "time" not in found:
        columns["time"] = clock
        completed["time"] = "time"
    return replace(table, columns=columns, notes=notes), completed


def _labels(table: Table, name: str, time: Array) -> NDArray[np.object_]:
    """Labels of the runs at other times: a label holds until the next one."""
    stamps = np.asarray(table.clocks[name], dtype=np.float64)
    labels = labels_of(table, name)
    order = np.argsort(stamps[np.isfinite(stamps)], kind="stable")
    stamps, labels = stamps[np.isfinite(stamps)][order], labels[np.isfinite(stamps)][order]
    if len(labels) == 0:
        raise MalformedLog(f"{table.name}: the channel '{name}' has no times, leave it out.")
    before = np.searchsorted(stamps, time, side="right") - 1
    return np.asarray(labels[np.maximum(before, 0)], dtype=object)


def _moved(table: Table, name: str, time: Array, drives: bool) -> Array:
    try:
        values = np.asarray(table.columns[name], dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise MalformedLog(f"{table.name}: a channel holds text among its numbers, export the log again.") from error
    stamps = np.asarray(table.clocks[name], dtype=np.float64)
    known = np.isfinite(stamps) & np.isfinite(values)
    stamps, values = stamps[known], values[known]
    if len(stamps) < 2 or np.any(np.diff(stamps) <= 0):
        raise MalformedLog(f"{table.name}: the time of channel '{name}' does not increase, export it again.")
    if drives and len(time) > 1 and np.median(np.diff(stamps)) < 0.75 * np.median(np.diff(time)):
        return _between(time, stamps, values)
    return _at(time, stamps, values)


def _between(time: Array, stamps: Array, values: Array) -> Array:
    """Means of a command from each time to the next: the same impulse as its faster samples.

    A sample is held until the next one. Where samples are missing the result is NaN.
    """
    steps = np.diff(stamps)
    usual = float(np.median(steps))
    edges = np.append(stamps, stamps[-1] + usual)
    held = np.append(steps, usual)
    until = np.append(time[1:], 2 * time[-1] - time[-2])

    def integral(rates: Array) -> Array:
        sums = np.append(0.0, np.cumsum(rates * held))
        return np.asarray(np.interp(until, edges, sums) - np.interp(time, edges, sums))

    known = (time >= edges[0]) & (np.minimum(until, edges[-1]) > time) & (until <= edges[-1] + usual)
    known &= integral((held > GAP * usual).astype(np.float64)) <= 0
    length = np.where(known, np.minimum(until, edges[-1]) - time, 1.0)
    return np.where(known, integral(values) / length, np.nan)


def _at(time: Array, stamps: Array, values: Array) -> Array:
    """Values at other times: linear between samples, the nearer sample at a jump such as a counter's wrap.

    Beyond the first and last sample, and where samples are missing between them, the result is NaN.
    """
    linear = np.interp(time, stamps, values, left=np.nan, right=np.nan)
    steps = np.diff(stamps)
    before = np.clip(np.searchsorted(stamps, time, side="right") - 1, 0, len(stamps) - 2)
    later = time - stamps[before] > stamps[before + 1] - time
    jumps = np.abs(np.diff(values))[before] > 0.5 * np.ptp(values)
    near = np.where(jumps & np.isfinite(linear), values[before + later], linear)
    measured = (time == stamps[before]) | (time == stamps[before + 1])
    return np.where((steps[before] > GAP * np.median(steps)) & ~measured, np.nan, near)
