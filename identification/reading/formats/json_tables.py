"""Logs in JSON: records, columns, rows with column names, time series in groups; and JSON lines."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.reading.formats.groups import grouped_table
from identification.reading.formats.messages import column_of, gathered, names_in
from identification.reading.formats.text import decoded
from identification.reading.table import Table

_DEEPEST = 20
_SUFFIXES = (".json", ".jsonl", ".ndjson")
_NAMES_OF_ROWS = ("columns", "header", "headers", "fields", "names")
_ROWS = ("data", "rows", "values")
_LONGEST_LIST = 256  # of groups
_DECODER = json.JSONDecoder(parse_int=float)  # whole numbers of any size


def parse_json(content: bytes, name: str, sha256: str) -> Table | None:
    """The table in a text of JSON or JSON lines, None for any other text.

    Raises `MalformedLog` if the text is damaged, or has no table.
    """
    claimed = any(suffix in name.lower() for suffix in _SUFFIXES)
    if content.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] not in (b"{", b"[") and not claimed:
        return None
    text = decoded(content, name)
    try:
        loaded, notes = _loaded(text, name)
    except MalformedLog:
        raise
    except (ValueError, RecursionError) as error:
        if not claimed:
            return None  # a text may begin like a list: `[key]; [value]`
        raise MalformedLog(f"{name}: this is no JSON ({_place(error)}), export the log again.") from error
    found = _Found()
    found.sort(loaded)
    tables = {path: group for path, group in found.groups.items() if any(v.dtype.kind == "f" for v in group.values())}
    table = grouped_table(tables, name, sha256)
    if not table.columns:
        raise MalformedLog(f"{name}: no records or lists of numbers are found in this JSON, export the log again.")
    return replace(
        table,
        columns={**_constants(loaded, table), **table.columns},
        notes=notes,
        joint_of={column: joint for column, joint in found.joint_of.items() if column in table.columns},
    )


def _constants(loaded: Any, table: Table) -> dict[str, NDArray[Any]]:
    """Numbers outside the table that hold for all rows, such as gains."""
    lengths = {len(values) for values in table.columns.values()}
    if not isinstance(loaded, Mapping) or len(lengths) != 1:
        return {}
    numbers = {key: value for key, value in loaded.items() if isinstance(value, int | float)}
    return {key: np.full(max(lengths), float(value)) for key, value in numbers.items()}


def _loaded(text: str, name: str) -> tuple[Any, tuple[str, ...]]:
    """The value of the text, or one value per line, and notes; raises `ValueError` if it is neither."""
    try:
        return _DECODER.decode(text.strip()), ()
    except ValueError as error:
        lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
        first = _DECODER.decode(lines[0][1].strip()) if len(lines) > 1 else None
        if not isinstance(first, dict | list):
            raise error from None
    records: list[Any] = []
    notes: tuple[str, ...] = ()
    for number, line in lines:
        try:
            records.append(_DECODER.decode(line.strip()))
        except ValueError as error:
            if number != lines[-1][0]:
                raise MalformedLog(
                    f"{name}, line {number}: this line is no JSON ({_place(error)}), repair or delete it."
                ) from error
            notes = (f"{name}: the last line ({number}) is cut off and left out",)
    return records, notes


def _place(error: Exception) -> str:
    if isinstance(error, json.JSONDecodeError):
        return f"line {error.lineno}, column {error.colno}"
    return type(error).__name__


@dataclass(kw_only=True)
class _Found:
    """Series by their group, and the joints of the columns."""

    groups: dict[str, dict[str, NDArray[Any]]] = field(default_factory=dict)
    joint_of: dict[str, tuple[str, str]] = field(default_factory=dict)

    def add(self, path: str, series: Mapping[str, NDArray[Any]]) -> None:
        """Add series of two samples or more to the group of a path."""
        kept = {key: values for key, values in series.items() if len(values) > 1}
        if kept:
            self.groups.setdefault(path, {}).update(kept)

    def sort(self, loaded: Any, path: str = "", depth: int = 0) -> None:
        """Add all series in a value of JSON."""
        loaded = _listed(loaded)
        if depth > _DEEPEST or not isinstance(loaded, Mapping | list):
            return
        if isinstance(loaded, Mapping):
            self._sort_mapping(_split(loaded) or loaded, path, depth)
        elif (matrix := _matrix(loaded)) is not None:
            self.add(path, matrix)
        elif all(isinstance(item, Mapping) for item in loaded) and len(loaded) > 1:
            if named := _named_series(loaded):
                self._sort_mapping(named, path, depth)
                return
            found = gathered(loaded)
            self.add(path, found.columns)
            self.joint_of.update(found.joint_of)
        else:
            for k, item in enumerate(loaded[:_LONGEST_LIST]):
                self.sort(item, path if len(loaded) == 1 else f"{path}/{k + 1}".lstrip("/"), depth + 1)

    def _sort_mapping(self, loaded: Mapping[str, Any], path: str, depth: int) -> None:
        if (runs := _runs(loaded)) is not None:
            self.add(path, runs)
            return
        names, labels = names_in(loaded, ())
        for key, value in ((key, _listed(value)) for key, value in loaded.items() if key != names):
            if isinstance(value, list) and value and all(isinstance(cell, str | int | float | None) for cell in value):
                self.add(path, {key: column_of([v if isinstance(v, str | None) else float(v) for v in value])})
            elif isinstance(value, list) and (matrix := _matrix(value)) is not None:
                if len(matrix) == len(labels):
                    matrix = dict(zip(labels, matrix.values(), strict=True))
                    self.joint_of.update({f"{key}:{label}": (label, key) for label in labels})
                self.add(path, {f"{key}:{place}": column for place, column in matrix.items()})
            else:
                self.sort(value, f"{path}/{key}".lstrip("/"), depth + 1)


def _listed(loaded: Any) -> Any:
    """A mapping with numbers as keys (a column of pandas) as a list, in its order; other values unchanged."""
    if not isinstance(loaded, Mapping) or len(loaded) < 2:
        return loaded
    if all(map(str.isdecimal, loaded)):
        return list(loaded.values())
    return loaded


def _split(loaded: Mapping[str, Any]) -> dict[str, Any] | None:
    """The columns of a mapping with rows and the names of their columns; None for any other mapping."""
    names = next((loaded[key] for key in _NAMES_OF_ROWS if _are_names(loaded.get(key))), None)
    rows = next((loaded[key] for key in _ROWS if isinstance(loaded.get(key), list)), None)
    matrix = _matrix(rows) if names and rows else None
    if names is None or rows is None or matrix is None or len(names) != len(matrix):
        return None
    columns: dict[str, Any] = dict(zip(names, (column.tolist() for column in matrix.values()), strict=True))
    index = loaded.get("index")
    is_labelled = isinstance(index, list) and len(index) == len(rows) and index != list(range(len(rows)))
    return {"index": index} | columns if is_labelled else columns


def _are_names(loaded: Any) -> bool:
    return isinstance(loaded, list) and all(isinstance(name, str) for name in loaded)


def _matrix(loaded: list[Any]) -> dict[str, NDArray[Any]] | None:
    """The columns of rows of equal length, by the names in a first row of texts, else by their numbers."""
    if (
        len(loaded) < 2
        or not all(isinstance(row, list) and len(row) == len(loaded[0]) for row in loaded)
        or not loaded[0]
    ):
        return None
    if not all(isinstance(cell, str | int | float | None) for row in loaded for cell in row):
        return None
    names = [str(k + 1) for k in range(len(loaded[0]))]
    if all(isinstance(cell, str) for cell in loaded[0]) and len(set(loaded[0])) == len(loaded[0]):
        names, loaded = list(loaded[0]), loaded[1:]
    columns = zip(*loaded, strict=True)
    return {
        name: column_of([cell if isinstance(cell, str | None) else float(cell) for cell in column])
        for name, column in zip(names, columns, strict=True)
    }


def _runs(loaded: Mapping[str, Any]) -> dict[str, NDArray[Any]] | None:
    """The columns of matrices that are runs of one experiment, with their keys as labels; None for other mappings.

    They have the same columns and different numbers of rows: channels of one recording have as many rows.
    """
    lists = {key: value for key, value in loaded.items() if isinstance(value, list)}
    matrices = {key: matrix for key, value in lists.items() if (matrix := _matrix(value)) is not None}
    headings = {tuple(matrix) for matrix in matrices.values()}
    lengths = {len(value) for value in lists.values()}
    if len(matrices) < 2 or len(matrices) < len(lists) or len(headings) > 1 or len(lengths) == 1:
        return None
    names = headings.pop()
    if "run" in names:
        return None
    labels: list[float | str | None] = [key for key, m in matrices.items() for _ in next(iter(m.values()))]
    whole = {name: np.concatenate([matrix[name] for matrix in matrices.values()]) for name in names}
    return {"run": column_of(labels), **whole}


def _named_series(loaded: list[Any]) -> dict[str, Any] | None:
    """Records that are named series instead of rows: `{"name": "angle", "time": [...], "value": [...]}`."""
    for key in ("name", "label", "topic", "id"):
        names = [item.get(key) for item in loaded]
        long = (any(isinstance(v, list) and len(v) > len(loaded) for v in item.values()) for item in loaded)
        if all(isinstance(name, str) for name in names) and len(set(names)) == len(names) and all(long):
            return dict(zip(names, loaded, strict=True))
    return None
