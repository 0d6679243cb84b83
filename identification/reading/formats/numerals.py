"""Numbers as people write them: with a decimal comma, with separators between the thousands."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_EXPONENT = r"([eEdD][+-]?\d+)?"  # Fortran writes D
_COMMA = re.compile(rf"[+-]?\d*,\d+{_EXPONENT}$")
_POINT = re.compile(rf"[+-]?\d*\.(\d{{1,2}}|\d{{4,}}){_EXPONENT}$")  # three digits might be thousands


@dataclass(frozen=True)
class _Writing:
    """One way to write numbers, as patterns: any number in it, and those that nobody would read otherwise."""

    thousands: str
    decimal: str

    def any_number(self) -> str:
        t, d = re.escape(self.thousands), re.escape(self.decimal)
        return rf"\s*[+-]?(\d*|[1-9]\d{{0,2}}({t}\d{{3}})+)({d}\d*)?{_EXPONENT}\s*"

    def beyond_doubt(self) -> str:
        t, d = re.escape(self.thousands), re.escape(self.decimal)
        grouped = rf"[1-9]\d{{0,2}}({t}\d{{3}})+{d}\d*|[1-9]\d{{0,2}}({t}\d{{3}}){{2,}}"
        return rf"\s*[+-]?({grouped}|\d*{d}(\d{{1,2}}|\d{{4,}})){_EXPONENT}\s*"


_ENGLISH, _CONTINENTAL = _Writing(",", "."), _Writing(".", ",")


def has_decimal_comma(cells: Sequence[str]) -> bool:
    """Whether the numbers of a table have a decimal comma: one does, and none has a decimal point."""
    points = re.compile(_ENGLISH.beyond_doubt())
    return any(map(_COMMA.match, cells)) and not any(_POINT.match(cell) or points.fullmatch(cell) for cell in cells)


def plain_numbers(values: NDArray[Any]) -> NDArray[Any]:
    """The column as floats where all its cells are numbers in one way of writing, at least one of them beyond doubt.

    Any other column is returned as it is.
    """
    if values.dtype.kind not in "OUT":
        return values
    import pandas as pd

    cells = pd.Series(values)
    given = cells[cells.notna()].astype(str)
    for writing in (_ENGLISH, _CONTINENTAL):
        if not given.head(50).str.fullmatch(writing.any_number()).all():  # dates and labels go at once
            continue
        if given.str.fullmatch(writing.beyond_doubt()).any() and given.str.fullmatch(writing.any_number()).all():
            bare = given.str.replace(writing.thousands, "", regex=False).str.replace(writing.decimal, ".", regex=False)
            bare = bare.str.replace("d", "e", case=False, regex=False)
            numbers = np.full(len(values), np.nan)
            numbers[cells.notna().to_numpy()] = pd.to_numeric(bare, errors="coerce").to_numpy(dtype=np.float64)
            return numbers
    return values
