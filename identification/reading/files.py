"""From a file to a table of named columns, nothing judged yet. Text tables have their own file."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.reading.table import Table

if TYPE_CHECKING:
    import pandas as pd

FORMATS = {
    ".csv": "text",
    ".txt": "text",
    ".tsv": "text",
    ".parquet": "parquet",
    ".pq": "parquet",
    ".mat": "mat",
    ".npz": "npz",
    ".mf4": "trade",
    ".tdms": "trade",
    ".mcap": "trade",
}


def read_table(path: str | Path) -> Table:
    """Read one file by its suffix: CSV (.csv, .txt, .tsv), Parquet, MAT (v5 to v7.3), NPZ, MF4, TDMS or MCAP.

    A matrix of k columns named `data` becomes the columns `data:1` to `data:k`.

    Raises `MalformedLog` when the file is missing, of another kind, or unreadable.
    """
    path = Path(path)
    kind = FORMATS.get(path.suffix.lower())
    if kind is None:
        raise MalformedLog(
            f"{path.name}: the suffix '{path.suffix}' is not a known log format, use one of {', '.join(FORMATS)}."
        )
    try:
        content = path.read_bytes()
    except FileNotFoundError as error:
        raise MalformedLog(f"{path}: there is no such file, check the path.") from error
    except OSError as error:
        raise MalformedLog(f"{path}: the file cannot be opened ({error.strerror}), check it.") from error
    if not content:
        raise MalformedLog(f"{path.name}: the file is empty, export the log again.")
    digest = hashlib.sha256(content).hexdigest()
    if kind == "text":
        from identification.reading.text import parse_text

        return parse_text(content, path.name, digest)
    if kind == "trade":
        from identification.reading.trade import read_trade

        return read_trade(content, path.name, digest)
    try:
        columns = {"parquet": _parquet, "mat": _mat, "npz": _npz}[kind](content)
    except Exception as error:  # the three parsers raise whatever their formats lead them to
        raise MalformedLog(
            f"{path.name}: not a readable {path.suffix} file ({type(error).__name__}), export the log again."
        ) from error
    if not columns:
        raise MalformedLog(f"{path.name}: the file holds no numeric columns, export the log again.")
    return Table(name=path.name, columns=columns, sha256=digest)


def columns_of(frame: pd.DataFrame) -> dict[str, NDArray[Any]]:
    """The columns of a DataFrame, and its index where that has a name: the time, more often than not."""
    index = frame.index.to_frame(index=False)
    columns = {str(name): index.iloc[:, k].to_numpy() for k, name in enumerate(frame.index.names) if name is not None}
    return columns | {str(name): frame[name].to_numpy() for name in dict.fromkeys(frame.columns)}


def _parquet(content: bytes) -> dict[str, NDArray[Any]]:
    import pandas as pd

    return columns_of(pd.read_parquet(io.BytesIO(content)))


def _npz(content: bytes) -> dict[str, NDArray[Any]]:
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        arrays = {}
        for name in archive.files:
            try:
                arrays[name] = archive[name]
            except ValueError:  # a pickled object: never loaded, and never a measured channel
                continue
    return _vectors(arrays)


def _mat(content: bytes) -> dict[str, NDArray[Any]]:
    if content[:128].startswith(b"MATLAB 7.3") or content[:8] == b"\x89HDF\r\n\x1a\n":
        return _vectors(_hdf5(content))
    from scipy.io import loadmat

    variables: dict[str, Any] = loadmat(io.BytesIO(content), squeeze_me=False)  # type: ignore[arg-type]
    arrays: dict[str, Any] = {}
    for name, value in variables.items():
        if name.startswith("__"):
            continue
        if isinstance(value, np.ndarray) and value.dtype.names and value.size == 1:  # a struct: its fields
            arrays |= {field: value[field].item() for field in value.dtype.names}
        else:
            arrays[name] = value
    return _vectors(arrays)


def _hdf5(content: bytes) -> dict[str, Any]:
    """Datasets of a v7.3 MAT file, groups included; MATLAB writes its matrices transposed."""
    import h5py

    arrays: dict[str, Any] = {}

    def keep(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiub" and not name.startswith("#refs#"):
            arrays[name.split("/")[-1]] = np.asarray(item).T

    with h5py.File(io.BytesIO(content), "r") as file:
        file.visititems(keep)
    return arrays


def _vectors(arrays: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """One column a vector; a matrix gives one column for each of its columns; scalars are no channels."""
    columns: dict[str, NDArray[Any]] = {}
    for name, value in arrays.items():
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiubmM" or value.size < 2:
            continue
        if value.ndim == 1 or value.size == max(value.shape):
            columns[name] = value.ravel()
        elif value.ndim == 2:
            matrix = value if value.shape[0] >= value.shape[1] else value.T
            columns |= {f"{name}:{k + 1}": matrix[:, k] for k in range(matrix.shape[1])}
    return columns
