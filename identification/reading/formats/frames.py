"""Tables of Apache Arrow and pandas: Parquet, Feather and frames, also with lists and structures in cells."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from identification.reading.formats.messages import Gathered, gathered
from identification.reading.table import Table

if TYPE_CHECKING:
    import pandas as pd


def read_parquet(content: bytes, name: str, sha256: str) -> Table:
    """The columns of a Parquet file."""
    import pyarrow.parquet as parquet

    return _from_arrow(parquet.read_table(io.BytesIO(content)), name, sha256)


def read_feather(content: bytes, name: str, sha256: str) -> Table:
    """The columns of a Feather file (an Arrow file)."""
    import pyarrow.feather as feather

    return _from_arrow(feather.read_table(io.BytesIO(content)), name, sha256)


def _from_arrow(table: Any, name: str, sha256: str) -> Table:
    table.validate(full=True)
    frame = table.to_pandas()
    metadata = {field.name: field.metadata or {} for field in table.schema}
    units = {
        column: (of.get(b"unit") or of.get(b"units") or b"").decode("utf-8", "replace")
        for column, of in metadata.items()
    }
    return replace(frame_table(frame, name, sha256), units={column: unit for column, unit in units.items() if unit})


def frame_table(frame: pd.DataFrame, name: str, sha256: str) -> Table:
    """The columns of a frame, as in `columns_of`, with their joints."""
    found = _gathered(frame)
    return Table(name=name, columns=found.columns, sha256=sha256, joint_of=found.joint_of)


def columns_of(frame: pd.DataFrame) -> dict[str, NDArray[Any]]:
    """The columns of a frame, and its index if that has a name: it is usually the time.

    Lists of numbers in the cells of `state` become `state:1`, `state:2`, ...; fields of structures `state.angle`. If
    columns have the same name, the first one is used.
    """
    return _gathered(frame).columns


def _gathered(frame: pd.DataFrame) -> Gathered:
    index = frame.index.to_frame(index=False)
    cells = {str(name): index.iloc[:, k].to_numpy() for k, name in enumerate(frame.index.names) if name is not None}
    for place, key in enumerate(frame.columns):
        name = ".".join(map(str, key)) if isinstance(key, tuple) else str(key)
        cells.setdefault(name, frame.iloc[:, place].to_numpy())
    found = Gathered()
    for name, values in cells.items():
        inside = _inside(name, values)
        found.columns.update({name: values} if inside is None else inside.columns)
        found.joint_of.update({} if inside is None else inside.joint_of)
    return found


def _inside(key: str, values: NDArray[Any]) -> Gathered | None:
    """The numbers in the cells of a column with lists or structures, None for any other column."""
    if values.dtype.kind != "O":
        return None
    first = next((cell for cell in values if cell is not None), None)
    if not isinstance(first, list | tuple | dict | np.ndarray):
        return None
    if isinstance(first, np.ndarray) and first.dtype.kind in "fiub" and first.ndim == 1 and len(first) > 1:
        same = all(isinstance(cell, np.ndarray) and cell.shape == first.shape for cell in values)
        if same:
            matrix = np.stack(list(values))
            return Gathered(columns={f"{key}:{k + 1}": matrix[:, k] for k in range(matrix.shape[1])})
    return gathered([{key: cell} for cell in values])
