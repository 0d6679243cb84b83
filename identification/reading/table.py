"""What a file holds before anything is judged: named columns, with clocks and units where it tells them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """Columns as the file holds them: any dtype, lengths may differ (MAT and NPZ files mix sizes).

    first_line: line of the first data row in a text file.
    notes: what the reader skipped, interpolated or left out, one sentence each.
    clocks: column -> times of its samples, as long as the column; columns that were sampled together share one array.
        Empty where the file has one row for each instant, and the time is a column like any other.
    units: column -> its unit as the file writes it; "time" is the unit of the clocks, [s] where it is not given.
    """

    name: str
    columns: Mapping[str, NDArray[Any]]
    sha256: str
    first_line: int | None = None
    notes: tuple[str, ...] = ()
    clocks: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
