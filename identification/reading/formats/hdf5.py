"""HDF5 files: datasets, groups of datasets, compound tables, and the frames that pandas writes; also MAT v7.3."""

from __future__ import annotations

import io
import pickletools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.reading.formats.groups import grouped_table, vectors, without_objects
from identification.reading.table import Table


def read_hdf5(content: bytes, name: str, sha256: str) -> Table:
    """The series of all datasets by name; a name that occurs several times is prefixed by the group.

    Raises `MalformedLog` if the file has objects of MATLAB only, such as a timeseries.
    """
    import h5py

    groups: dict[str, dict[str, NDArray[Any]]] = {}
    objects: list[tuple[str, str]] = []
    units: dict[tuple[str, str], str] = {}

    def visit(path: str, item: Any) -> None:
        parent, _, key = path.rpartition("/")
        beside = path.startswith("#") or "/_i_" in f"/{path}"  # the inside of MATLAB's objects, the indices of PyTables
        if beside or not isinstance(item, h5py.Dataset):
            return
        if "MATLAB_object_decode" in item.attrs:
            objects.append((path.replace("/", "."), _text(item.attrs.get("MATLAB_class", b""), "object")))
            return
        found = _of_pandas(parent, key, item)
        series = vectors({key: item[()]}) if found is None else found
        groups.setdefault(parent, {}).update(series)
        units.update(dict.fromkeys(((parent, name) for name in series), _unit(item)) if _unit(item) else {})

    with h5py.File(io.BytesIO(content), "r") as file:
        file.visititems(visit)
    return without_objects(grouped_table(groups, name, sha256, units), objects)


def _unit(item: Any) -> str:
    """The unit in the attributes of a dataset; for a time of NetCDF, "seconds since 2024-01-01", the unit alone."""
    unit = next((item.attrs[key] for key in ("units", "unit", "Units", "Unit") if key in item.attrs), "")
    unit = unit.item() if isinstance(unit, np.ndarray) and unit.size == 1 else unit
    return _text(unit, "").split(" since ")[0] if isinstance(unit, str | bytes) else ""


def _of_pandas(parent: str, key: str, item: Any) -> dict[str, NDArray[Any]] | None:
    """The columns of a frame written by pandas, none for its auxiliary datasets; None for any other dataset."""
    frame = item.parent
    kind = frame.attrs.get("pandas_type", b"")
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    if kind == "frame":  # blocks of values, and the names of their columns
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
            values = rows[field]
            names = _pickled_texts(item.attrs.get(f"{field}_kind")) if values.ndim == 2 else []
            columns |= vectors(_by_name(values, names) if names else {field: values})
        texts = _pickled_texts(frame.attrs.get("info"))
        called = texts[texts.index("index_name") + 1] if "index_name" in texts[:-1] else "index"
        return {called if name == "index" else name: values for name, values in columns.items()}
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


def _pickled_texts(content: Any) -> list[str]:
    """The texts in a pickle with pandas' names of columns; its opcodes are read, it is never loaded."""
    if content is None:
        return []
    raw = content.encode() if isinstance(content, str) else bytes(content)
    try:
        codes = list(pickletools.genops(raw))
    except ValueError:
        return []
    return [str(text) for code, text, _ in codes if "UNICODE" in code.name or "STRING" in code.name]
