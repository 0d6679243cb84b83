"""HDF5 files: datasets, groups of datasets, compound tables, and the frames that pandas writes; also MAT v7.3."""

from __future__ import annotations

import io
import pickletools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.reading.groups import grouped_table, vectors
from identification.reading.table import Table


def read_hdf5(content: bytes, name: str, sha256: str) -> Table:
    """The series of all datasets, by name or, where two are called alike, with their group before them."""
    import h5py

    groups: dict[str, dict[str, NDArray[Any]]] = {}

    def visit(path: str, item: Any) -> None:
        parent, _, key = path.rpartition("/")
        if path.startswith("#refs#") or not isinstance(item, h5py.Dataset):
            return
        found = _of_pandas(parent, key, item)
        groups.setdefault(parent, {}).update(vectors({key: item[()]}) if found is None else found)

    with h5py.File(io.BytesIO(content), "r") as file:
        file.visititems(visit)
    return grouped_table(groups, name, sha256)


def _of_pandas(parent: str, key: str, item: Any) -> dict[str, NDArray[Any]] | None:
    """The columns of a frame that pandas wrote, nothing for what it writes beside; None for any other dataset."""
    frame = item.parent
    kind = frame.attrs.get("pandas_type", b"")
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    if kind == "frame":  # blocks of values beside the names of their columns
        if key == "axis1":
            return vectors({_text(item.attrs.get("name", "index"), "index"): item[()]})
        if key.endswith("_values") and f"{key[:-7]}_items" in frame:
            names = [_text(cell, "") for cell in frame[f"{key[:-7]}_items"][()]]
            return vectors(_by_name(np.asarray(item), names))
        return {}
    if kind == "frame_table" and key == "table":
        rows = item[()]
        columns: dict[str, NDArray[Any]] = {}
        for field in rows.dtype.names:
            names = _names_of_block(item.attrs.get(f"{field}_kind"))
            values = rows[field]
            columns |= vectors(_by_name(values, names) if values.ndim == 2 and names else {field: values})
        return columns
    return {} if kind else None


def _by_name(values: NDArray[Any], names: list[str]) -> dict[str, NDArray[Any]]:
    return (
        {name: values[:, k] for k, name in enumerate(names)}
        if values.ndim == 2 and values.shape[1] == len(names)
        else {}
    )


def _text(value: Any, otherwise: str) -> str:
    text = value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
    return otherwise if text in ("", "N.") else text  # "N." is a pickled None


def _names_of_block(kind: Any) -> list[str]:
    """The names of the columns in a block, which pandas keeps pickled: their texts are read, nothing is loaded."""
    if kind is None:
        return []
    raw = str(kind).encode() if isinstance(kind, str) else bytes(kind)
    return [
        str(argument)
        for code, argument, _ in pickletools.genops(raw)
        if "UNICODE" in code.name or "STRING" in code.name
    ]
