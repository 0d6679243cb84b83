"""Numbers in local notation: with a decimal comma, with separators of thousands."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

_EXPONENT = r"([eEdD][+-]?\d+)?"  # Fortran writes D
_COMMA = re.compile(rf"[+-]?\d*,\d+{_EXPONENT}$")
_POINT = re.compile(rf"[+-]?\d*\.(\d{{1,2}}|\d{{4,}}){_EXPONENT}$")  # three digits might be thousands


@dataclass(frozen=True)
class _Writing:
    """One notation of numbers, as patterns: any number in it, and unambiguous numbers."""

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
    """Whether the numbers of a table have a decimal comma: at least one has, and none has a decimal point."""
    points = re.compile(_ENGLISH.beyond_doubt())
    return any(map(_COMMA.match, cells)) and not any(_POINT.match(cell) or points.fullmatch(cell) for cell in cells)


def plain_columns(columns: Sequence[NDArray[Any]]) -> list[NDArray[Any]]:
    """The columns of a table; those with numbers in one notation as floats.

    A column needs an unambiguous number, or an unambiguous column in the same table, as the notation is the same. Other
    columns are returned unchanged.
    """
    found = [plain_numbers(column) for column in columns]
    used = {writing for column in columns if (writing := _writing_of(column)) is not None}
    if len(used) != 1:
        return found
    (writing,) = used
    return [
        _as_floats(column, writing) if column.dtype.kind in "OUT" and _all_in(column, writing) else column
        for column in found
    ]


def plain_numbers(values: NDArray[Any]) -> NDArray[Any]:
    """The column as floats if all its cells are numbers in one notation, at least one of them unambiguous.

    Any other column is returned unchanged.
    """
    writing = _writing_of(values)
    return values if writing is None else _as_floats(values, writing)


def _writing_of(values: NDArray[Any]) -> _Writing | None:
    """The notation of all cells of a column, if at least one is unambiguous; else None."""
    if values.dtype.kind not in "OUT":
        return None
    for writing in (_ENGLISH, _CONTINENTAL):
        if _all_in(values, writing) and _given(values).str.fullmatch(writing.beyond_doubt()).any():
            return writing
    return None


def _given(values: NDArray[Any]) -> pd.Series[str]:
    import pandas as pd

    cells = pd.Series(values)
    return cells[cells.notna()].astype(str)


def _all_in(values: NDArray[Any], writing: _Writing) -> bool:
    """Whether the column has cells and each one is a number in a notation."""
    given = _given(values)
    pattern = writing.any_number()
    if not len(given) or not given.head(50).str.fullmatch(pattern).all():  # quick test for dates and labels
        return False
    return bool(given.str.fullmatch(pattern).all())


def _as_floats(values: NDArray[Any], writing: _Writing) -> NDArray[Any]:
    import pandas as pd

    given = _given(values)
    bare = given.str.replace(writing.thousands, "", regex=False).str.replace(writing.decimal, ".", regex=False)
    bare = bare.str.replace("d", "e", case=False, regex=False)
    numbers = np.full(len(values), np.nan)
    numbers[given.index] = pd.to_numeric(bare, errors="coerce").to_numpy(dtype=np.float64)
    return numbers
