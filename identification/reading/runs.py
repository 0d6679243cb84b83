"""Split the rows of a table into experiments."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.reading.row_order import RowNote, sorted_rows
from identification.reading.table import Table
from identification.recording import Array, Recording, counted


def labels_of(table: Table, name: str) -> NDArray[np.object_]:
    """(T,) the cells of a column, of any type, as labels of experiments; "" for an empty cell."""
    import pandas as pd

    raw: NDArray[Any] = np.asarray(table.columns[name])
    if raw.ndim != 1:
        raise MalformedLog(f"{table.name}: the column '{name}' has shape {raw.shape}, give one label for each sample.")
    cells = pd.Series(raw)
    codes, kinds = pd.factorize(cells.map(_written) if raw.dtype.kind == "O" else cells)
    labels = np.array([*map(_written, kinds), ""], dtype=object)[codes]  # a code of -1 is an empty cell
    labels[np.asarray(cells.isna())] = ""
    return labels


def _written(label: Any) -> str:
    """A label as text: 3 for a float in a run column with empty cells."""
    return f"{label:.15g}" if isinstance(label, float | np.floating) else str(label).strip()


def split_runs(whole: Recording, labels: NDArray[np.object_] | None) -> tuple[tuple[Recording, ...], tuple[str, ...]]:
    """One recording per label, in order of appearance, and per restart of the time; and sentences on disorder.

    A label that returns later continues its experiment.

    Raises `MalformedLog` if the labels do not separate experiments, or if the rows have no recognisable order.
    """
    whole = replace(whole, start=_start(whole.time))
    notes: list[str] = []
    groups = [("", whole)]
    if labels is not None:
        whole, labels, notes = _labelled(whole, labels)
        groups = [(str(label), whole.take(labels == label)) for label in dict.fromkeys(labels)]
    start = min(_start(group.time) for _, group in groups)  # a later run may have been recorded before
    found: list[Recording] = []
    row_notes: list[RowNote] = []
    for label, group in groups:
        parts, done = sorted_rows(replace(group, start=start))
        row_notes += done
        for place, part in enumerate(parts):
            again = f" ({place + 1})" if place else ""
            run = label + again if label else str(place)
            named = f"{whole.label} run {run}" if label or len(parts) > 1 else whole.label
            found.append(replace(part, number=len(found), run=run, label=named))
    return tuple(found), (*notes, *_sentences(row_notes))


def _start(time: Array) -> float:
    """The time of the first sample; in a table with the newest row on top this is the last row."""
    known = time[np.isfinite(time)]
    if len(known) == 0:
        return 0.0
    return float(known[-1] if np.all(np.diff(known) <= 0) else known[0])


def _labelled(whole: Recording, labels: NDArray[np.object_]) -> tuple[Recording, NDArray[np.object_], list[str]]:
    """The rows that have a label. If each label occurs in a single row, it begins an experiment."""
    known = labels != ""
    if not known.any():
        raise MalformedLog(f"{whole.label}: the run column '{whole.name('run')}' is empty, leave it out.")
    different = len(set(labels[known]))
    if different == known.sum() and different < len(labels):
        last = np.maximum.accumulate(np.where(known, np.arange(len(labels)), -1))
        labels = np.where(last >= 0, labels[last], "")
        known = labels != ""
    elif different > 1 and 2 * different > len(labels):
        raise MalformedLog(
            f"{whole.label}: the run column '{whole.name('run')}' has {different} labels in {len(labels)} rows, so it "
            "numbers no experiments; leave it out or map another one."
        )
    if known.all():
        return whole, labels, []
    first = whole.where(int(np.flatnonzero(~known)[0]))
    note = f"{first}: {counted(int((~known).sum()), 'row')} without a label in '{whole.name('run')}' left out"
    return whole.take(known), labels[known], [note]


def _sentences(row_notes: Iterable[RowNote]) -> list[str]:
    """One sentence per kind of disorder: its first place, and the number of further places."""
    kinds: dict[str, list[RowNote]] = {}
    for one in row_notes:
        kinds.setdefault(one.kind, []).append(one)
    return [
        f"{ones[0].where}: {ones[0].text}" + (f"; {len(ones) - 1} more such places" if len(ones) > 1 else "")
        for ones in kinds.values()
    ]
