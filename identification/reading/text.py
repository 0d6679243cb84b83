"""Text tables as engineers' tools export them: any separator, decimal commas, one time column per channel."""

from __future__ import annotations

import csv
import io
import re
from typing import Any

from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.reading.scope import find_scope_header, group_starts, read_groups
from identification.reading.table import Table

_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$")
_NO_NUMBER = {"nan", "na", "null", "inf", "-inf"}
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?$")
_COMMENT = ("#", "%", "//")
_SEARCHED_LINES = 200  # no export has a longer preamble


def parse_text(content: bytes, name: str, sha256: str) -> Table:
    """The columns of a text table, and what was skipped.

    Raises `MalformedLog` when there is no header, no data, or a line that does not fit.
    """
    lines = _decode(content, name).splitlines()
    while lines and lines[-1].strip() in ("", "EOF"):
        lines.pop()
    notes: tuple[str, ...] = ()
    scope = find_scope_header(lines)
    if scope is not None:
        separator, start, header = scope.separator, scope.data_line, list(scope.names)
    else:
        separator, start = _layout(lines, name)
        header_line, header = _header(lines, separator, start, name)
        if start - header_line > 1:
            notes += (
                f"{name}: the lines {header_line + 2} to {start} between the names and the data are not read; "
                "units written there must be given with --unit",
            )
    width = len(header)
    starts = group_starts(header)
    grouped = len(starts) > 1 or scope is not None
    ends = {width, *starts} if grouped else {width}  # where the slower groups have ended, rows are shorter
    last = len(_split(lines[-1], separator))
    if len(lines) > start + 1 and last < width and last not in ends:
        notes += (f"{name}: the last line ({len(lines)}) is cut off and left out",)
        lines.pop()
    decimal = "," if _has_decimal_comma(lines[start:], separator) else "."
    cells = max(len(_split(lines[start], separator)), width)
    frame = _parse(lines[start:], separator, decimal, cells, start, name)[:width]
    if not grouped:
        columns = {column: v for column, v in zip(_unique(header), frame, strict=True) if column}  # unnamed: index
        return Table(name=name, columns=columns, sha256=sha256, first_line=start + 1, notes=notes)
    groups = read_groups(header, frame, scope, name)
    return Table(
        name=name,
        columns=groups.columns,
        sha256=sha256,
        first_line=start + 1 if groups.row_by_row else None,
        notes=notes + groups.notes,
        clocks=groups.clocks,
        units=groups.units,
    )


def _decode(content: bytes, name: str) -> str:
    wide = content[:2] in (b"\xff\xfe", b"\xfe\xff")
    for encoding in ("utf-16",) if wide else ("utf-8-sig", "latin-1"):  # latin-1 reads any byte
        try:
            text = content.decode(encoding)
        except UnicodeError:
            continue
        if "\0" not in text:
            return text
    raise MalformedLog(f"{name}: this is not a text table, check the file or its suffix.")


def _split(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    try:
        cells = next(csv.reader([line], delimiter=separator), [])
    except csv.Error:
        cells = line.split(separator)
    return [cell.strip() for cell in cells]


def _is_value(cell: str) -> bool:
    return bool(_NUMBER.match(cell) or _DATE.match(cell)) or cell.lower() in _NO_NUMBER


def _is_data(cells: list[str]) -> bool:
    filled = [cell for cell in cells if cell]
    return 2 * sum(map(_is_value, filled)) > len(filled)


def _layout(lines: list[str], name: str) -> tuple[str, int]:
    """Separator and index of the first data line: two columns or more, and another such line below it."""
    searched = lines[:_SEARCHED_LINES]
    for separator in ("\t", ";", "|", ",", " "):  # the comma late: it may be the decimal point
        table = [[] if line.lstrip().startswith(_COMMENT) else _split(line, separator) for line in searched]
        for index, cells in enumerate(table):
            below = table[index + 1] if index + 1 < len(table) else cells
            if len(cells) < 2 or len(below) != len(cells) or not (_is_data(cells) and _is_data(below)):
                continue
            if cells[0] and not _is_value(cells[0]) and _is_value(below[0]):  # names: time, 6064, 6077
                continue
            return separator, index
    raise MalformedLog(
        f"{name}: no table of numbers is found; a log needs one line of column names and then rows of "
        "numbers separated by comma, semicolon, tab or |."
    )


def _header(lines: list[str], separator: str, start: int, name: str) -> tuple[int, list[str]]:
    """The names: of the lines right above the data with as many cells, the fullest one, and of these the first."""
    data = _split(lines[start], separator)
    width = len(data)
    while data and not data[-1]:  # some exports end each row, but not the names, with a separator
        data.pop()
    best: tuple[int, list[str]] | None = None
    for index in range(start - 1, -1, -1):
        cells = _split(lines[index].lstrip("#% "), separator)
        while len(cells) > width and not cells[-1]:
            cells.pop()
        if not len(data) <= len(cells) <= width or not any(cells):
            if best is None and lines[index].strip():
                raise MalformedLog(
                    f"{name}, line {start + 1}: the data have {width} columns but the line of names above has "
                    f"{len(cells)}, make them match."
                )
            break
        if best is None or sum(map(bool, cells)) >= sum(map(bool, best[1])):
            best = (index, cells)
    if best is None:
        raise MalformedLog(f"{name}: no column names stand above the numbers, add a line like time,torque,angle.")
    return best


def _unique(header: list[str]) -> list[str]:
    """The first of several columns of one name keeps it."""
    seen: set[str] = set()
    names = []
    for column in header:
        names.append("" if column in seen else column)
        seen.add(column)
    return names


def _has_decimal_comma(lines: list[str], separator: str) -> bool:
    cells = [cell for line in lines[:_SEARCHED_LINES] for cell in _split(line, separator)]
    return any(_DECIMAL_COMMA.match(cell) for cell in cells)


def _parse(lines: list[str], separator: str, decimal: str, width: int, start: int, name: str) -> list[NDArray[Any]]:
    import pandas as pd

    try:
        frame = pd.read_csv(
            io.StringIO("\n".join(lines)),
            sep=r"\s+" if separator == " " else separator,
            decimal=decimal,
            header=None,
            names=list(range(width)),
            index_col=False,
            skip_blank_lines=False,  # so that rows keep their line numbers
            skipinitialspace=True,
            low_memory=False,
        )
    except Exception as error:  # ParserError, but also ValueError and OverflowError
        found = re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", str(error))
        if found:
            line = int(found[2]) + start
            raise MalformedLog(
                f"{name}, line {line}: {found[3]} cells where the names give {width}, repair or delete this line."
            ) from error
        found = re.search(r"EOF inside string starting at row (\d+)", str(error))
        if found:
            line = int(found[1]) + start + 1
            raise MalformedLog(f"{name}, line {line}: a quotation mark is opened and not closed, remove it.") from error
        raise MalformedLog(f"{name}: the table cannot be read ({type(error).__name__}), export it again.") from error
    if len(frame) != len(lines):
        raise MalformedLog(f"{name}: a quotation mark is opened and not closed, remove it.")
    return [frame[k].to_numpy() for k in range(width)]
