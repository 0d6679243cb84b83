"""The cells of a column as numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.reading.table import Table
from identification.recording import Array


def numbers_of(table: Table, name: str, column: str) -> Array:
    """The column as floats."""
    raw: NDArray[Any] = np.asarray(table.columns[name])
    if raw.ndim != 1:
        raise MalformedLog(
            f"{table.name}: the column '{name}' has shape {raw.shape}, give one number for each sample of '{column}'."
        )
    if raw.dtype.kind in "fiub":
        return raw.astype(np.float64)
    import pandas as pd

    try:
        numbers = np.asarray(pd.to_numeric(pd.Series(raw), errors="coerce"))
    except (ValueError, TypeError):  # cells that are lists, records, ...
        numbers = np.asarray([None])
    if numbers.dtype.kind not in "fiub" or raw.dtype.kind in "mM":
        raise MalformedLog(f"{table.name}: the column '{name}' does not hold plain numbers, export it again.")
    numbers = numbers.astype(np.float64)
    bad = np.flatnonzero(np.isnan(numbers) & ~np.asarray(pd.isna(pd.Series(raw))))
    if len(bad):
        row = int(bad[0])
        raise MalformedLog(
            f"{table.where(row)}, column '{name}': {str(raw[row])[:30]!r} is not a number, repair or delete this row."
        )
    return numbers
