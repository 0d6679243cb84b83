"""Rows of units below the names of a table, `s;N m;rad`, `(s),(V)`, and lines above it with units and labels.

LabVIEW writes `Y_Unit_Label` for all columns except the time, oscilloscopes `Vertical Units` and `Label`.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence

from identification.reading.column_meaning import is_time
from identification.reading.units import is_unit

NO_UNIT = {"", "-", "--", "1", "none", "(none)", "n/a", "[]", "[-]", "()", "(-)"}
"""Texts in files for a column without a unit."""

_BRACKETS = re.compile(r"^[\[(<{]\s*(.*?)\s*[\])>}]$")
_UNITS_ABOVE = {"y_unit_label", "vertical units", "units", "unit", "einheit", "einheiten"}
_LABELS_ABOVE = {"label", "labels"}
_NUMBERED = re.compile(r"ch(annel|an)?[ _]?\d+", re.I)  # names without a meaning
_LONGEST = 24  # characters of a unit; a longer text is a description


def row_of_units(cells: Sequence[str]) -> list[str] | None:
    """The unit of each column, "" without one; None if the row has anything else."""
    units = [_unit(cell) for cell in cells]
    if not any(units) or None in units:
        return None
    return [unit or "" for unit in units]


def _unit(cell: str) -> str | None:
    """The unit in a cell, "" without one; None if the cell is anything else."""
    text = cell.strip()
    if text.lower() in NO_UNIT:
        return ""
    text = _BRACKETS.sub(r"\1", text)
    if len(text) > _LONGEST or re.match(r"[\d.+-]", text.replace("1/", "")):
        return None
    return text if text == "%" or is_unit(text) else None


def names_below(generic: Sequence[str], row: Sequence[str]) -> tuple[list[str], list[str]] | None:
    """Names and units from two lines, `Time;Channel 1` above `ms;Speed`: the second has the unit of the time.

    None if the lines are not so.
    """
    unit = _unit(row[0])
    if not unit or not is_time(generic[0]) or any(map(_unit, row[1:])) or not any(row[1:]):
        return None
    return [generic[0], *row[1:]], [unit, *[""] * len(row[1:])]


def units_above(above: Iterable[Sequence[str]], width: int) -> list[str] | None:
    """The units of the columns from a line of the preamble; None without such a line."""
    for cells in _rows_above(above, _UNITS_ABOVE, width):
        if (units := row_of_units(cells)) is not None:
            return units
    return None


def labelled(names: Sequence[str], above: Iterable[Sequence[str]]) -> list[str]:
    """The names, with a `CH1` replaced by its label in the preamble."""
    for labels in _rows_above(above, _LABELS_ABOVE, len(names)):
        called = [
            label if label and _NUMBERED.fullmatch(name) else name for name, label in zip(names, labels, strict=True)
        ]
        if len(set(called)) == len(called):
            return called
    return list(names)


def _rows_above(above: Iterable[Sequence[str]], keys: Collection[str], width: int) -> Iterator[list[str]]:
    """The cells of lines that begin with one of the keys: one per column, or one per column except the time."""
    for cells in above:
        if not cells or cells[0].strip().strip(":#").strip().lower() not in keys:
            continue
        rest = [cell.strip() for cell in cells[1:]]
        while len(rest) > width - 1 and rest and not rest[-1]:  # LabVIEW has a column of comments
            rest.pop()
        if len(rest) in (width, width - 1):
            yield ["", *rest][-width:]
