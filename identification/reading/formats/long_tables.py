"""Long tables: one row per sample and channel with a name, a time and a value, as exported by databases."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.reading.column_meaning import is_time
from identification.reading.headings import heading
from identification.reading.table import Table
from identification.reading.time_stamps import seconds_of

_NAMES = {"name", "varname", "field", "signal", "channel", "variable", "tag", "metric", "sensor", "item", "parameter"}
_VALUES = {"value", "varvalue", "values", "wert", "valeur", "valor"}
_MOST = 64  # most channels; a column with more labels does not have names of channels
_LEAST = 10  # samples of each


def with_channels(table: Table) -> Table:
    """A long table converted to one column per channel, each with its clock; any other table unchanged."""
    names = [key for key in table.columns if _called(key, _NAMES) and table.columns[key].dtype.kind in "OUT"]
    values = [key for key in table.columns if _called(key, _VALUES) and table.columns[key].dtype.kind in "fiu"]
    if len(names) != 1 or len(values) != 1 or table.clocks:
        return table
    labels = np.asarray([str(label).strip() for label in table.columns[names[0]]], dtype=object)
    channels = dict.fromkeys(labels)
    rows = {label: np.flatnonzero(labels == label) for label in channels} if len(channels) <= _MOST else {}
    if len(rows) < 2 or min(map(len, rows.values())) < _LEAST:
        return table
    times = _times(table)
    if times is None:
        return table
    seconds, unit = times
    columns = {label: np.asarray(table.columns[values[0]])[of] for label, of in rows.items()}
    clocks = {label: seconds[of] for label, of in rows.items()}
    note = f"{table.name}: a row is a sample of one channel, called as in '{names[0]}'; each has its own time"
    return Table(
        name=table.name,
        columns=columns,
        sha256=table.sha256,
        notes=(*table.notes, note),
        clocks=clocks,
        units={"time": unit} if unit else {},
    )


def _called(name: str, words: set[str]) -> bool:
    own_words = heading(name).words
    return bool(own_words) and (own_words[-1] in words or "".join(own_words) in words)


def _times(table: Table) -> tuple[NDArray[np.float64], str] | None:
    """The times of the rows and their unit (dates have priority and need none); None if no column is a time."""
    found = [key for key in table.columns if is_time(key) or _called(key, {"timestring", "datetime", "date"})]
    for key in sorted(found, key=lambda key: table.columns[key].dtype.kind in "fiu"):
        try:
            seconds, _ = seconds_of(replace(table, rows=None), key, None)
        except MalformedLog:
            continue
        unit = (table.units.get(key, "") or heading(key).unit) if table.columns[key].dtype.kind in "fiu" else ""
        return np.asarray(seconds, dtype=np.float64), unit
    return None
