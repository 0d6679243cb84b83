"""The layout of a table in a text file: its separator, names, units and first row; lines above are preamble."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

from identification.errors import MalformedLog
from identification.reading.column_meaning import is_time
from identification.reading.formats.unit_row import labelled, names_below, row_of_units, units_above

COMMENT = ("#", "%", "//")
SEARCHED_LINES = 200  # no export has a longer preamble
_SEPARATORS = ("\t", ";", "|", ",", " ")  # the comma is tried late: it may be the decimal comma
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)*|[.,]\d+)([eEdD][+-]?\d+)?$")
_END_OF_HEADER = re.compile(r"\W*end[ _]?of[ _]?header\W*$", re.I)  # of LabVIEW, occurs twice
_LIST = re.compile(r"[\[(][-+.,;\d\seE]+[\])]$")
_NO_NUMBER = {"nan", "na", "null", "inf", "-inf", "none"}
_STAMP = re.compile(r"\d{1,4}([-./])\d{1,2}\1\d{1,4}([T ].*)?$|\d{1,3}:\d\d(:\d\d([.,:]\d+)?)?( ?[ap]m)?$", re.I)


@dataclass(frozen=True, kw_only=True)
class Layout:
    """The layout of a text file.

    names, units: of each column, "" without one; both are empty if no line of names is found.
    start: index of the first line of data.
    unread: numbers of other lines between the names and the data, counted from 1.
    """

    separator: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    start: int
    unread: tuple[int, ...] = ()


def find_layout(lines: Sequence[str], name: str) -> Layout:
    """The layout of a table of numbers.

    Raises `MalformedLog` if there is no table, or if the line of names above it does not fit.
    """
    separator, start = _first_row(lines, name)
    above = _lines_above(lines, separator, start, name)
    units = row_of_units(above[0][1]) if len(above) > 1 else None
    rest = above[1:] if units else above
    if not rest:
        return Layout(separator=separator, names=(), units=(), start=start)
    if units is None and len(rest) > 1 and (both := names_below(rest[1][1], rest[0][1])) is not None:
        return Layout(separator=separator, names=tuple(both[0]), units=tuple(both[1]), start=start)
    line, names = max(rest, key=lambda found: _names_score(found[1]))  # the nearest one of equal score
    preamble = [split(text, separator) for text in lines[max(line - SEARCHED_LINES, 0) : line]]
    units = units or units_above(preamble, len(names)) or []
    return Layout(
        separator=separator,
        names=tuple(labelled(names, preamble)),
        units=tuple([*units, *[""] * len(names)][: len(names)]),
        start=start,
        unread=tuple(sorted(index + 1 for index, _ in rest if index > line)),
    )


def split(line: str, separator: str) -> list[str]:
    """The cells of a line, without surrounding blanks and quotation marks."""
    if separator == " ":
        return line.split() if '"' not in line else [cell for cell in _quoted(line, " ") if cell]
    return _quoted(line, separator)


def _quoted(line: str, separator: str) -> list[str]:
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:
        cells = line.split(separator)
    return [cell.strip() for cell in cells]


def _is_value(cell: str) -> bool:
    return bool(_NUMBER.match(cell) or _STAMP.match(cell) or _LIST.match(cell)) or cell.lower() in _NO_NUMBER


def _is_data(cells: list[str]) -> bool:
    filled = [cell for cell in cells if cell]
    return 2 * sum(map(_is_value, filled)) > len(filled)


def _first_row(lines: Sequence[str], name: str) -> tuple[str, int]:
    """Separator and index of the first line of data: another one is below it; else the text is a single column.

    A preamble may have lines of numbers too, of another width than most, above a line of text.
    """
    begin = _after_header(lines)
    rows_with_text = (
        (index, line)
        for index, line in enumerate(lines[begin:], begin)
        if line.strip() and not line.lstrip().startswith(COMMENT)
    )
    searched = list(islice(rows_with_text, SEARCHED_LINES))
    for separator in _SEPARATORS:
        table = [split(line, separator) for _, line in searched]
        widths = Counter(len(cells) for cells in table if len(cells) > 1 and _is_data(cells))
        usual = max(widths, key=lambda width: widths[width], default=0)
        for k, cells in enumerate(table):
            below = table[k + 1] if k + 1 < len(table) else cells
            if (
                len(cells) < 2
                or len(below) != len(cells)
                or not (_is_data(cells) and _is_data(below))
                or (len(cells) != usual and _ends_in_text(table[k:]))
            ):
                continue
            if cells[0] and not _is_value(cells[0]) and _is_value(below[0]):  # names: time, 6064, 6077
                continue
            if _counts_columns(cells) and not _counts_columns(below):  # names: 0, 1, 2
                continue
            return separator, searched[k][0]
    if (alone := _single_column(searched)) is not None:
        return ",", alone
    raise MalformedLog(
        f"{name}: no table of numbers is found; a log needs one line of column names and then rows of "
        "numbers separated by comma, semicolon, tab or |."
    )


def _ends_in_text(table: Sequence[list[str]]) -> bool:
    """Whether lines of numbers end in a line of text before their width changes: then they are a preamble."""
    after = next((cells for cells in table if len(cells) != len(table[0]) or not _is_data(cells)), None)
    return after is not None and not _is_data(after)


def _single_column(lines: Sequence[tuple[int, str]]) -> int | None:
    """Index of the first of at least three lines of one number each, to the last; above them may be one name."""
    numbers = [bool(_NUMBER.match(line.strip())) for _, line in lines]
    start = numbers.index(True) if True in numbers else len(lines)
    return lines[start][0] if start <= 1 and len(lines) - start > 2 and all(numbers[start:]) else None


def _after_header(lines: Sequence[str]) -> int:
    """Index of the first line after a header with an explicit end, else 0."""
    return max((k + 1 for k, line in enumerate(lines[:SEARCHED_LINES]) if _END_OF_HEADER.match(line)), default=0)


def _counts_columns(cells: list[str]) -> bool:
    """Whether a row has the numbers of the columns, as for a matrix of pandas: 0,1,2 with or without an index."""
    named = cells[1:] if not cells[0] else cells
    return len(named) > 2 and named == [str(k) for k in range(int(named[0] == "1"), len(named) + (named[0] == "1"))]


def _lines_above(lines: Sequence[str], separator: str, start: int, name: str) -> list[tuple[int, list[str]]]:
    """Index and cells of the lines above the data that may hold names or units, the nearest first."""
    first = split(lines[start], separator)
    width = len(first)
    while first and not first[-1]:  # some exports end each row, but not the names, with a separator
        first.pop()
    second = next((line for line in lines[start + 1 :] if line.strip()), "")
    numbered = first[0] == "1" and split(second, separator)[:1] == ["2"]
    above: list[tuple[int, list[str]]] = []
    for index in range(start - 1, max(start - SEARCHED_LINES, _after_header(lines)) - 1, -1):
        cells = _as_names(lines[index], separator, len(first), width, numbered=numbered)
        if cells:
            above.append((index, cells))
        elif lines[index].strip() and not lines[index].lstrip().startswith(COMMENT):
            if not above:
                _refuse_names(lines[index], separator, width, f"{name}, line {start + 1}")
            break
    return above


def _as_names(line: str, separator: str, filled: int, width: int, *, numbered: bool) -> list[str]:
    """The cells of a line above the data if their number fits, else none.

    NumPy may write names separated by commas above columns separated by blanks; R has no name for the row numbers.
    """
    bare = line.lstrip("#%/ " if separator == "\t" else "#%/ \t")
    order = [separator] if separator != " " else []
    tried = [split(bare, other) for other in dict.fromkeys((*order, *_SEPARATORS[:-1]))]
    if separator == " ":  # names separated by several blanks may contain a blank
        tried += [re.split(r"\s{2,}", bare.strip()), split(bare, " ")]
    for cells in tried:
        while len(cells) > width and cells[-1] in ("", "Comment"):  # LabVIEW has a name for a column that its rows lack
            cells.pop()
        if (len(cells) > 1 or width == 1) and any(cells):
            if filled <= len(cells) <= width:
                return cells
            if numbered and len(cells) == width - 1:
                return ["", *cells]
    return []


def _refuse_names(line: str, separator: str, width: int, where: str) -> None:
    """Raise an error for too few or too many names; ignore a sentence above the numbers."""
    cells = split(line, separator)
    prose = len(cells) < 2 or any(map(_is_value, cells)) or (separator == " " and not any(map(is_time, cells)))
    if not prose:
        raise MalformedLog(
            f"{where}: the data have {width} columns but the line of names above has {len(cells)}, make them match."
        )


def _names_score(cells: list[str]) -> tuple[bool, bool, int]:
    """Score of a line as names: whether one is a time, whether all are distinct and not numbers, number of names."""
    filled = [cell for cell in cells if cell]
    distinct = len(set(filled)) == len(filled) and not any(map(_is_value, filled))
    return any(map(is_time, filled)), distinct, len(filled)
