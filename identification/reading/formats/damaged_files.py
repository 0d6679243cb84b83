"""Guard for readers of binary formats: an exception of a library becomes one sentence, its output is suppressed."""

from __future__ import annotations

import gc
import io
import logging
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from typing import TypeAlias

from identification.errors import MalformedLog
from identification.reading.table import Table

Read: TypeAlias = Callable[[bytes, str, str], Table]
"""From the content of a file, its name and its hash to a table; may raise any exception of its library."""

_FORMATS = {  # name: usual suffix, library
    "Excel": (".xlsx", "openpyxl"),
    "Feather": (".feather", "pyarrow"),
    "HDF5": (".h5", "h5py"),
    "MAT": (".mat", "scipy"),
    "MCAP": (".mcap", "mcap and mcap-ros2-support"),
    "MF4": (".mf4", "asammdf"),
    "NPY": (".npy", "numpy"),
    "NPZ": (".npz", "numpy"),
    "Parquet": (".parquet", "pyarrow"),
    "TDMS": (".tdms", "npTDMS"),
}


def guarded(read: Read, content: bytes, name: str, sha256: str, kind: str) -> Table:
    """The table of a file, from its reader.

    Raises `MalformedLog` if its library is not installed, or if the file is damaged or has no columns.
    """
    suffix, library = _FORMATS[kind]
    problem = ""
    table: Table | None = None
    with _quiet():
        try:
            table = read(content, name, sha256)
        except ImportError:
            problem = f"{suffix} files are read by {library}, install it with pip install 'antidrive[logs]'"
        except MalformedLog as error:
            problem = str(error).removesuffix(".").removeprefix(f"{name}: ")
        except Exception as error:  # a damaged file may raise any exception
            problem = f"not a readable {suffix} file ({type(error).__name__}), export the log again"
        if problem and kind == "MF4":
            gc.collect()  # run asammdf's finaliser now, while its message is suppressed
    if table is not None and not table.columns:
        problem = "the file holds no numeric columns, export the log again"
    if table is None or problem:
        raise MalformedLog(f"{name}: {problem}.")
    return table


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress output: libraries log to stderr, and asammdf's finaliser fails for a file that it could not open."""
    disabled, hook = logging.root.manager.disable, sys.unraisablehook
    logging.disable(logging.CRITICAL)
    sys.unraisablehook = lambda _: None
    try:
        with warnings.catch_warnings(), redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(disabled)
        sys.unraisablehook = hook
