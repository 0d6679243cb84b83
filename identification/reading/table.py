"""The content of a file before any check: named columns, with clocks and units if the file has them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """Columns as in the file: any dtype, lengths may differ (MAT and NPZ files mix sizes).

    The name of a column without a name is its number, counted from 1: "3" is the third.

    first_line: line of row 1 in a text file.
    rows: (T,) the number of each row, counted from 1 at `first_line`; None if no line between them was left out.
    notes: what the reader skipped, interpolated or left out, one sentence each.
    clocks: column -> times of its samples, as long as the column; columns that were sampled together share one array.
        Empty if the file has one row for each instant, and the time is an ordinary column.
    units: column -> its unit as in the file; "time" is the unit of the clocks, [s] if it is not given.
    joint_of: column -> its joint and its name without the joint, `position:elbow` -> ("elbow", "position").
    """

    name: str
    columns: Mapping[str, NDArray[Any]]
    sha256: str
    first_line: int | None = None
    rows: NDArray[np.int64] | None = None
    notes: tuple[str, ...] = ()
    clocks: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    joint_of: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints of the columns; empty for a single axis."""
        return tuple(dict.fromkeys(joint for joint, _ in self.joint_of.values()))

    def row(self, index: int) -> int:
        """Number of the row at an index of the columns."""
        return index + 1 if self.rows is None else int(self.rows[index])

    def where(self, index: int) -> str:
        """File, row and line of an index of the columns, for messages."""
        row = self.row(index)
        return f"{self.name}, row {row}" + ("" if self.first_line is None else f" (line {row + self.first_line - 1})")


def table_of(columns: Mapping[str, NDArray[Any]], label: str) -> Table:
    """The table of columns that are not from a file, with the hash of their content."""
    digest = hashlib.sha256()
    for name, values in columns.items():
        digest.update(name.encode())
        digest.update(repr(values.tolist()).encode() if values.dtype.kind == "O" else values.tobytes())
    return Table(name=label, columns=columns, sha256=digest.hexdigest())
