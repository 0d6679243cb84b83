"""Rows of units below the names of a table: `s;N m;rad`, `(s),(V)`, `second,Volt,Volt`."""

from __future__ import annotations

import re
from collections.abc import Sequence

from identification.reading.units import is_unit

NO_UNIT = {"", "-", "--", "1", "none", "(none)", "n/a", "[]", "[-]", "()", "(-)"}
"""What files write where a column has no unit."""

_BRACKETS = re.compile(r"^[\[(<{]\s*(.*?)\s*[\])>}]$")
_LONGEST = 24  # characters of a unit; what is longer is a description


def row_of_units(cells: Sequence[str]) -> list[str] | None:
    """The unit of each column, "" where it has none; None where the row holds anything else."""
    units = [_unit(cell) for cell in cells]
    if not any(units) or None in units:
        return None
    return [unit or "" for unit in units]


def _unit(cell: str) -> str | None:
    """The unit in a cell, None where it is no unit."""
    text = cell.strip()
    if text.lower() in NO_UNIT:
        return ""
    text = _BRACKETS.sub(r"\1", text)
    if len(text) > _LONGEST or re.match(r"[\d.+-]", text.replace("1/", "")):
        return None
    return text if is_unit(text) else None
