"""Rows that are not in the order of time: several experiments in one table, shuffled rows, the newest row on top.

A few late rows fill gaps in the time of the rows before. A new experiment overlaps the one before in time, or lies
before it. This distinguishes shuffled rows, which are sorted, from a new run.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identification.checks.timing import GAP, MIN_SAMPLES
from identification.errors import MalformedLog
from identification.recording import Array, Recording, counted
from plant.number import HUGE


@dataclass(frozen=True, kw_only=True)
class RowNote:
    """The treatment of rows out of order: its kind, the place, and the sentence after the place."""

    kind: str
    where: str
    text: str


def sorted_rows(recording: Recording) -> tuple[list[Recording], list[RowNote]]:
    """The experiments in a recording, each with a time that does not decrease, and the treatment of the rows.

    Raises `MalformedLog` if the rows have no recognisable order.
    """
    time = recording.time
    if not np.all(np.abs(time) < HUGE):  # the check of the time raises the error
        return [recording], []
    steps = np.diff(time)
    if not np.any(steps < 0):
        return [recording], []
    if np.all(steps <= 0):
        text = "the rows run backwards in time and are read from the last to the first"
        return [recording.take(slice(None, None, -1))], [RowNote(kind="turned", where=recording.label, text=text)]
    begins, late, odd = _disorder(time)
    edges = [*begins, len(recording)]
    longest = max(b - a for a, b in pairwise(edges))
    if longest < min(MIN_SAMPLES, len(recording)) or 2 * len(late) > len(recording):
        first = int(np.flatnonzero(steps < 0)[0]) + 1
        raise MalformedLog(
            f"{recording.where(first)}: the time goes back from {time[first - 1] - recording.start:.6g} s, and in "
            f"{int(np.sum(steps < 0))} of {len(time)} rows, so their order is unknown; sort the rows, or number "
            "the experiments in a column 'run'."
        )
    row_notes = [
        RowNote(
            kind="new run",
            where=recording.where(begin),
            text=f"the time goes back by {time[begin - 1] - time[begin]:.4g} s, so a new run begins there",
        )
        for begin in begins[1:]
    ]
    for kind, rows, done in (("sorted", late, "out of order, sorted"), ("odd", odd, "out of its place, left out")):
        if len(rows):
            text = f"{counted(len(rows), 'row')} with a time {done}"
            row_notes.append(RowNote(kind=kind, where=recording.where(rows[0]), text=text))
    kept = np.ones(len(recording), dtype=bool)
    kept[odd] = False
    parts = []
    for a, b in pairwise(edges):
        places = np.arange(a, b)[kept[a:b]]
        parts.append(recording.take(places[np.argsort(time[places], kind="stable")]))
    return parts, row_notes


def _disorder(time: Array) -> tuple[list[int], list[int], list[int]]:
    """First rows of the experiments, late rows within an experiment, and rows with a time that fits nowhere."""
    steps = np.diff(np.sort(time))
    step = float(np.median(steps[steps > 0]))
    out_of_order = _out_of_order(time, step)
    begins: list[int] = [0]
    late: list[int] = []
    odd: list[int] = []
    top, seen, done = -np.inf, 0, 0  # latest time of the experiment, rows it covers, rows classified
    for i in map(int, np.flatnonzero(np.diff(time) < 0) + 1):
        if i < done:
            continue
        before = max(top, float(time[seen : i - 1].max(initial=-np.inf)))
        top, seen = max(before, float(time[i - 1])), i
        ahead = np.flatnonzero(time[i : i + MIN_SAMPLES] > top)
        stop = i + int(ahead[0]) if len(ahead) else len(time)
        if stop - i < MIN_SAMPLES and _fill_holes(time, begins[-1], i, stop, step):
            late += range(i, stop)
            seen = done = stop
        elif out_of_order[i]:
            odd.append(i)
            seen = i + 1
        elif out_of_order[i - 1]:
            odd.append(i - 1)
            top = before
        else:
            begins.append(i)
            top = -np.inf
    return begins, late, odd


def _out_of_order(time: Array, step: float) -> NDArray[np.bool_]:
    """Rows (T,) with a time that is not between the times of their neighbours, which are consecutive."""
    out_of_order = np.zeros(len(time), dtype=bool)
    across = time[2:] - time[:-2]
    between = (time[1:-1] >= time[:-2]) & (time[1:-1] <= time[2:])
    out_of_order[1:-1] = (across > 0) & (across <= GAP * step) & ~between
    return out_of_order


def _fill_holes(time: Array, begin: int, i: int, stop: int, step: float) -> bool:
    """Whether the rows i to stop, sorted by time, fill gaps, with no more rows per time than elsewhere."""
    late = time[i:stop]
    first = max(begin, i - 2 * MIN_SAMPLES)
    if first > begin and time[first] > late.min():  # too old
        return False
    around = np.sort(np.append(time[first:i], time[stop : stop + 1]))
    after = np.searchsorted(around, late, side="right")
    before, behind = np.append(-np.inf, around)[after], np.append(around, np.inf)[after]
    hole = np.where(np.isfinite(before), behind - before, 2 * (behind - late))
    low, top = float(late.min()), float(around.max())
    rows = int(np.sum((around >= low) & (around <= top))) + len(late)
    return bool(np.all(hole > 1.5 * step) and rows <= 1.5 * ((top - low) / step + 1))
