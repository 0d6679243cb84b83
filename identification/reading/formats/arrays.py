"""Arrays by name: MAT files of MATLAB (v4 to v7.3), and NPZ and NPY files of NumPy. No pickle is ever loaded."""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from identification.reading.formats.groups import grouped_table, vectors, without_objects
from identification.reading.formats.hdf5 import read_hdf5
from identification.reading.table import Table

_DESCRIBES = ("dimensions", "label", "title", "blockName", "plotStyle", "stateName")  # fields that describe a signal


def read_npz(content: bytes, name: str, sha256: str) -> Table:
    """The arrays of an NPZ archive: one column per vector and one per column of a matrix."""
    arrays = {}
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        for key in archive.files:
            try:
                arrays[key] = archive[key]
            except ValueError:  # a pickled object: never loaded, and never a measured channel
                continue
    return Table(name=name, columns=vectors(arrays), sha256=sha256)


def read_npy(content: bytes, name: str, sha256: str) -> Table:
    """The columns of one array; the names of a matrix's columns are their numbers, from "1" on."""
    array = np.load(io.BytesIO(content), allow_pickle=False)
    columns = vectors({"": array})
    return Table(name=name, columns={key.removeprefix(":"): v for key, v in columns.items()}, sha256=sha256)


def read_mat(content: bytes, name: str, sha256: str) -> Table:
    """The variables of a MAT file, and the fields of structures at any depth.

    Raises `MalformedLog` if it has objects of MATLAB only, such as a timeseries.
    """
    if content.startswith(b"MATLAB 7.3"):
        return read_hdf5(content, name, sha256)
    from scipy.io import loadmat

    variables: dict[str, Any] = loadmat(io.BytesIO(content), squeeze_me=False)  # type: ignore[arg-type]
    found = _Variables()
    for key, value in variables.items():
        if not key.startswith("__"):
            found.sort(key, value, "")
    table = grouped_table({path: vectors(arrays) for path, arrays in found.groups.items()}, name, sha256)
    return without_objects(table, found.objects)


@dataclass(frozen=True)
class _Variables:
    """Arrays by the structure that contains them, and name and class of MATLAB objects."""

    groups: dict[str, dict[str, Any]] = field(default_factory=lambda: {"": {}})
    objects: list[tuple[str, str]] = field(default_factory=list)

    def sort(self, key: str, value: Any, path: str) -> None:
        """Add a variable, or a field of the structure at `path`."""
        from scipy.io.matlab import MatlabOpaque

        inside = f"{path}/{key}" if path else key
        if isinstance(value, MatlabOpaque):
            self.objects.append((_text(value["s0"]) or inside, _text(value["s2"])))
        elif isinstance(value, np.ndarray) and value.dtype.names and value.size:
            elements = value.ravel()
            for k, element in enumerate(elements):
                own = inside if len(elements) == 1 else f"{path}/{key}({k + 1})".lstrip("/")
                if "values" in value.dtype.names and path:  # Simulink's "structure with time"
                    label = _label(element) or (f"{key}({k + 1})" if len(elements) > 1 else "")
                    own = f"{path}/{label}" if label else path
                for name in value.dtype.names:
                    if name not in _DESCRIBES:
                        self.sort(name, element[name], own)
        else:
            self.groups.setdefault(path, {})[key] = value


def _label(element: Any) -> str:
    """The name of a signal in Simulink's "structure with time": its label, else its block."""
    names = element.dtype.names
    if "values" not in names:
        return ""
    block = _text(element["blockName"]).rsplit("/", 1)[-1] if "blockName" in names else ""
    return (_text(element["label"]) if "label" in names else "") or block


def _text(value: Any) -> str:
    """The first text in an array of texts, "" without one."""
    while isinstance(value, np.ndarray):
        if not value.size:
            return ""
        value = value.ravel()[0]
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value).strip()
