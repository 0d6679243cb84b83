"""Arrays by name: MAT files of MATLAB (v4 to v7.3), and NPZ and NPY files of NumPy. No pickle is ever loaded."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from identification.reading.formats.groups import grouped_table, vectors
from identification.reading.formats.hdf5 import read_hdf5
from identification.reading.table import Table


def read_npz(content: bytes, name: str, sha256: str) -> Table:
    """The arrays of an NPZ archive, as one column a vector and one for each column of a matrix."""
    arrays = {}
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        for key in archive.files:
            try:
                arrays[key] = archive[key]
            except ValueError:  # a pickled object: never loaded, and never a measured channel
                continue
    return Table(name=name, columns=vectors(arrays), sha256=sha256)


def read_npy(content: bytes, name: str, sha256: str) -> Table:
    """The columns of one array; those of a matrix have their places for names, from "1" on."""
    array = np.load(io.BytesIO(content), allow_pickle=False)
    columns = vectors({"": array})
    return Table(name=name, columns={key.removeprefix(":"): v for key, v in columns.items()}, sha256=sha256)


def read_mat(content: bytes, name: str, sha256: str) -> Table:
    """The variables of a MAT file; of a structure, its fields, and of those their fields."""
    if content.startswith(b"MATLAB 7.3"):
        return read_hdf5(content, name, sha256)
    from scipy.io import loadmat

    variables: dict[str, Any] = loadmat(io.BytesIO(content), squeeze_me=False)  # type: ignore[arg-type]
    groups: dict[str, dict[str, Any]] = {"": {}}
    for key, value in variables.items():
        if not key.startswith("__"):
            _sort(key, value, "", groups)
    return grouped_table({path: vectors(arrays) for path, arrays in groups.items()}, name, sha256)


def _sort(key: str, value: Any, path: str, groups: dict[str, dict[str, Any]]) -> None:
    if isinstance(value, np.ndarray) and value.dtype.names and value.size == 1:
        inside = f"{path}/{key}" if path else key
        for field in value.dtype.names:
            _sort(field, value[field].item(), inside, groups)
    else:
        groups.setdefault(path, {})[key] = value
