"""Series in groups, as in HDF5 and JSON: one table of rows, or channels on the clock of their group."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.reading.column_meaning import is_time, time_unit
from identification.reading.headings import heading
from identification.reading.table import Table

Groups = Mapping[str, Mapping[str, NDArray[Any]]]
"""Path of a group -> name of a series -> its values; "" is the path of series without a group."""

_OF_RUNS = {
    *("run", "experiment", "exp", "trial", "episode", "test", "repetition", "rep", "measurement", "demo", "sweep"),
    *("trajectory", "traj", "take", "versuch", "messung"),
}  # words in the name of a group that is one of several experiments
_VALUES = ("value", "values", "data", "y")  # names that are less specific than that of their group


def vectors(arrays: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """One column per vector and per column of a matrix; scalars are ignored."""
    columns: dict[str, NDArray[Any]] = {}
    for name, value in arrays.items():
        if not isinstance(value, np.ndarray) or value.size < 2:
            continue
        if value.dtype.names:  # a compound: its fields
            fields = vectors({field: value[field] for field in value.dtype.names})
            columns |= {field if len(arrays) == 1 else f"{name}.{field}": column for field, column in fields.items()}
        elif value.dtype.kind in "SU" and value.ndim == 1:  # labels of runs
            columns[name] = np.asarray([_text(cell) for cell in value], dtype=object)
        elif value.dtype.kind not in "fiubmM":
            continue
        elif value.ndim == 1 or value.size == max(value.shape):
            columns[name] = value.ravel()
        elif value.ndim == 2:
            matrix = value if value.shape[0] >= value.shape[1] else value.T
            columns |= {f"{name}:{k + 1}": matrix[:, k] for k in range(matrix.shape[1])}
    return columns


def _text(cell: Any) -> str:
    return cell.decode("utf-8", "replace") if isinstance(cell, bytes) else str(cell)


def grouped_table(groups: Groups, name: str, sha256: str, stated: Mapping[tuple[str, str], str] | None = None) -> Table:
    """A table of all series; if groups have different times, these are the clocks of their channels.

    A name that several series have is prefixed by the group.

    stated: unit of a series, by the path of its group and its name.
    """
    given = stated or {}
    of_all = {key: unit for (_, key), unit in given.items()}
    groups = _with_runs({path: group for path, group in groups.items() if group})
    times = {path: next((key for key in group if is_time(key)), "") for path, group in groups.items()}
    stamps = [groups[path][key] for path, key in times.items() if key]
    apart = any(not np.array_equal(stamps[0], other) for other in stamps[1:])
    clocked = {path for path, key in times.items() if key and apart}
    keys = [
        (path, key) for path, group in groups.items() for key in group if not (path in clocked and key == times[path])
    ]
    called = {place: _name(*place, groups, times) for place in keys}
    many = Counter(called.values())
    columns: dict[str, NDArray[Any]] = {}
    clocks: dict[str, NDArray[Any]] = {}
    units: dict[str, str] = {}
    for (path, key), short in called.items():
        full = short if many[short] == 1 else f"{path}/{key}"
        if many[short] > 1 and key == times[path] and not apart:  # all groups have the same time
            full = key
        columns.setdefault(full, groups[path][key])
        if unit := given.get((path, key)) or (of_all.get(key, "") if not path else ""):  # for joined runs: their unit
            units[full] = unit
        if path in clocked and len(groups[path][key]) == len(groups[path][times[path]]):
            clocks[full] = groups[path][times[path]]
    unit = next((given.get((path, times[path])) or time_unit(times[path]) for path in clocked), "")
    units |= {"time": unit} if unit else {}
    return Table(name=name, columns=columns, sha256=sha256, clocks=clocks, units=units)


def _with_runs(groups: Groups) -> Groups:
    """Join groups with the same series and paths that differ only in an experiment; a column `run` has its name."""
    paths = [path.split("/") for path in groups]
    keys = [tuple(group) for group in groups.values()]
    if len(paths) < 2 or len(set(keys)) > 1 or len({len(path) for path in paths}) > 1 or "run" in keys[0]:
        return groups
    differ = [k for k, parts in enumerate(zip(*paths, strict=True)) if len(set(parts)) > 1]
    if len(differ) != 1 or not all(_OF_RUNS & set(heading(path[differ[0]]).words) for path in paths):
        return groups
    lengths = [{len(values) for values in group.values()} for group in groups.values()]
    if any(len(length) > 1 for length in lengths):
        return groups
    labels = np.repeat(np.asarray([path[differ[0]] for path in paths], dtype=object), [min(one) for one in lengths])
    series = {key: np.concatenate([group[key] for group in groups.values()]) for key in keys[0]}
    return {"": {**series, "run": labels}}


def without_objects(table: Table, objects: Sequence[tuple[str, str]]) -> Table:
    """The table with a note on objects of MATLAB (name and class), which only MATLAB can read.

    Raises `MalformedLog` if there are only such objects.
    """
    if not objects:
        return table
    name, kind = objects[0]
    reason = f"'{name}' is an object of MATLAB ({kind}), which only MATLAB reads"
    signal = f"{name}{{1}}.Values" if kind.endswith("Dataset") else name  # a Dataset of Simulink holds several
    remedy = f"save its arrays, for example t = {signal}.Time; x = {signal}.Data; save('log.mat', 't', 'x')"
    if not table.columns:
        raise MalformedLog(f"{table.name}: {reason}; {remedy}.")
    return replace(table, notes=(*table.notes, f"{table.name}: {reason}, and is left out; {remedy}"))


def _name(path: str, key: str, groups: Groups, times: Mapping[str, str]) -> str:
    """The name of a series, or that of its group if it is the only one there and has a name such as `value`."""
    alone = path and all(other == key or other == times[path] for other in groups[path])
    return path.rsplit("/", 1)[-1] if alone and key.lower() in _VALUES else key
