"""Text tables as exported by engineering tools: any separator, decimal commas, one time column per channel."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.reading.formats.can_bus import refuse_bus
from identification.reading.formats.codesys import is_trace, read_trace
from identification.reading.formats.layout import COMMENT, SEARCHED_LINES, Layout, find_layout, split
from identification.reading.formats.list_cells import with_lists
from identification.reading.formats.numerals import has_decimal_comma, plain_columns
from identification.reading.formats.oscilloscopes import oscilloscope
from identification.reading.formats.twincat_scope import ScopeHeader, find_scope_header, group_starts, read_groups
from identification.reading.table import Table

_LINES_OF_A_NAME = 8  # most lines of a quoted name: "Time", "(s)"
_LEAST_SAMPLES = 100  # of signals in rows; no log has as many columns
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
_AS_DATA_BEGIN = frozenset("0123456789+-.,;\t")  # first characters of ordinary lines of data


def parse_text(content: bytes, name: str, sha256: str) -> Table:
    """The columns of a text table, with notes on skipped lines.

    Raises `MalformedLog` if there is no data, or a line that does not fit.
    """
    lines = _lines(decoded(content, name))
    refuse_bus(lines, name)
    garbled = bool(_CONTROL.search(lines[0])) if lines else False
    lines[:1] = [""] if garbled else lines[:1]
    if is_trace(lines):
        return read_trace(lines, name, sha256)
    scope = find_scope_header(lines)
    lines, layout = _layout(lines, scope, name)
    first = split(lines[layout.start], layout.separator)
    width = len(layout.names) or len(first)
    starts = group_starts(layout.names)
    grouped = len(starts) > 1 or scope is not None
    body = _body(lines, layout.start, name)
    notes = [*_unread(layout, name), *body.notes]
    if garbled:
        notes.append(
            f"{name}: the first line is incomplete, as where a serial port is opened within a line; it is left out"
        )
    ends = {width, *starts} if grouped else {width}  # rows are shorter after the end of slower groups
    last = len(split(body.lines[-1], layout.separator))
    if len(body.lines) > 1 and last < width and last not in ends:
        notes.append(f"{name}: the last line ({body.line(len(body.lines))}) is cut off and left out")
        body.lines.pop()
    columns = _parse(body, layout.separator, max(len(first), width), name)
    if grouped and any(np.asarray(column == column).any() for column in columns[width:]):
        raise MalformedLog(
            f"{name}, line {body.first_line}: the data have {len(columns)} columns but the line of names above has "
            f"{width}, so it is unclear which name belongs to which column; make them match."
        )
    columns = columns[:width]
    if not (layout.names or grouped) and (signals := _in_rows(columns)) is not None:
        notes.append(f"{name}: each of its {len(signals)} lines is one signal")
        return Table(name=name, columns=signals, sha256=sha256, notes=tuple(notes))
    if grouped:
        groups = read_groups(layout.names, columns, scope, layout.units, name)
        return Table(
            name=name,
            columns=groups.columns,
            sha256=sha256,
            first_line=body.first_line if groups.row_by_row else None,
            rows=body.kept_rows if groups.row_by_row else None,
            notes=(*notes, *groups.notes),
            clocks=groups.clocks,
            units=groups.units,
        )
    names = _called(layout.names or ("",) * width, columns)
    if not layout.names:
        called = f"columns are called 1 to {len(names)}" if len(names) > 1 else "column is called 1"
        notes.append(f"{name}: no column names stand above the numbers; the {called}")
    spread = with_lists(dict(zip(names, columns, strict=False)))
    return Table(
        name=name,
        columns=spread.columns,
        sha256=sha256,
        first_line=body.first_line,
        rows=body.kept_rows,
        notes=tuple(notes),
        units={column: unit for column, unit in zip(names, layout.units, strict=False) if unit},
        joint_of=spread.joint_of,
    )


def _layout(lines: list[str], scope: ScopeHeader | None, name: str) -> tuple[list[str], Layout]:
    """The lines of a text and their layout; an oscilloscope's export without a plain table is rewritten as one."""
    if scope is not None:
        bare = ("",) * len(scope.names)
        return lines, Layout(separator=scope.separator, names=scope.names, units=bare, start=scope.data_line)
    return oscilloscope(lines, name) or (lines, find_layout(lines, name))


def decoded(content: bytes, name: str) -> str:
    """The text of a file in UTF-8, UTF-16 with its byte order mark, or Latin-1.

    Raises `MalformedLog` if it is not text.
    """
    wide = content[:2] in (b"\xff\xfe", b"\xfe\xff")
    for encoding in ("utf-16",) if wide else ("utf-8-sig", "latin-1"):  # latin-1 reads any byte
        try:
            text = content.decode(encoding)
        except UnicodeError:
            continue
        if "\0" not in text.partition("\n")[2]:  # the first line of a serial port may hold anything
            return text
    raise MalformedLog(f"{name}: this is not a text table, check the file or its suffix.")


def _lines(text: str) -> list[str]:
    """The lines, with any line ending: csv.writer on Windows writes CR CR LF."""
    lines = text.replace("\r\r\n", "\n").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    while lines and lines[-1].strip() in ("", "EOF"):
        lines.pop()
    return _whole_names(lines)


def _whole_names(lines: list[str]) -> list[str]:
    """The lines, with quoted names that continue on further lines joined; those lines become blank."""
    for k in range(min(len(lines) - 1, SEARCHED_LINES)):
        end = k + 1
        while lines[k].count('"') % 2 and end < min(len(lines), k + _LINES_OF_A_NAME):
            lines[k], lines[end] = f"{lines[k]} {lines[end]}", ""
            end += 1
    return lines


@dataclass(frozen=True, kw_only=True, eq=False)
class _Body:
    """The lines of data; `rows`: number of each, counted from 1 at the first one, None if no line was left out."""

    lines: list[str]
    first_line: int
    rows: NDArray[np.int64] | None
    notes: tuple[str, ...]

    def line(self, number: int) -> int:
        """Line in the file of the data line with this number, counted from 1."""
        return self.first_line - 1 + (number if self.rows is None else int(self.rows[number - 1]))

    @property
    def kept_rows(self) -> NDArray[np.int64] | None:
        """`rows` without the lines that were left out at the end."""
        return None if self.rows is None else self.rows[: len(self.lines)]


def _body(lines: list[str], start: int, name: str) -> _Body:
    """The lines from the first row on, without blank lines, comments, and repeated headers."""
    head = {line for line in lines[max(start - SEARCHED_LINES, 0) : start] if line.strip()}
    suspects = [k for k in range(start, len(lines)) if lines[k][:1] not in _AS_DATA_BEGIN]
    again = [k for k in suspects if lines[k] in head]
    out = {k for k in suspects if not lines[k].strip() or lines[k].lstrip().startswith(COMMENT)}.union(again)
    notes: tuple[str, ...] = ()
    if again:
        notes = (f"{name}: the header is repeated from line {again[0] + 1} on; the repeats are skipped",)
    if not out:
        return _Body(lines=lines[start:], first_line=start + 1, rows=None, notes=notes)
    kept = [k for k in range(start, len(lines)) if k not in out]
    rows = np.asarray(kept, dtype=np.int64) - start + 1
    return _Body(lines=[lines[k] for k in kept], first_line=start + 1, rows=rows, notes=notes)


def _unread(layout: Layout, name: str) -> list[str]:
    if not layout.unread:
        return []
    first, last = layout.unread[0], layout.unread[-1]
    lines = f"line {first} is" if first == last else f"the lines {first} to {last} are"
    return [f"{name}: {lines} skipped, as there are no names, units or numbers"]


def _in_rows(columns: list[NDArray[Any]]) -> dict[str, NDArray[Any]] | None:
    """The signals of a text with few long lines of one signal each, which may begin with its name; else None."""
    count, labelled = len(columns[0]), columns[0].dtype.kind == "O"
    numbers = columns[labelled:]
    if len(columns) < _LEAST_SAMPLES or len(columns) < 10 * count or any(c.dtype.kind not in "fiu" for c in numbers):
        return None
    names = [str(label).strip() for label in columns[0]] if labelled else [str(k + 1) for k in range(count)]
    if len(set(names)) < count:
        return None
    return dict(zip(names, np.column_stack(numbers).astype(np.float64), strict=True)) if count > 1 else None


def _called(header: Sequence[str], columns: list[NDArray[Any]]) -> list[str]:
    """The name of each column: from the header if not used before, else its number; empty last columns are dropped."""
    width = len(columns)
    while width and not header[width - 1] and np.asarray(columns[width - 1] != columns[width - 1]).all():
        width -= 1
    names: list[str] = []
    for place, column in enumerate(header[:width], 1):
        called = column if column not in names else ""
        own = str(place)
        while not called:
            called, own = ("" if own in header or own in names else own), f":{own}"
        names.append(called)
    return names


def _parse(body: _Body, separator: str, width: int, name: str) -> list[NDArray[Any]]:
    import pandas as pd

    sample = [cell for line in body.lines[:SEARCHED_LINES] for cell in split(line, separator)]
    decimal = "," if has_decimal_comma(sample) else "."
    try:
        frame = pd.read_csv(
            io.StringIO("\n".join(body.lines)),
            sep=r"\s+" if separator == " " else separator,
            decimal=decimal,
            header=None,
            names=list(range(width)),
            index_col=False,
            skip_blank_lines=False,  # line numbers must not change
            skipinitialspace=True,
            low_memory=False,
        )
    except Exception as error:  # ParserError, but also ValueError and OverflowError
        found = re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", str(error))
        if found:
            raise MalformedLog(
                f"{name}, line {body.line(int(found[2]))}: {found[3]} cells where the names give {width}, "
                "repair or delete this line."
            ) from error
        found = re.search(r"EOF inside string starting at row (\d+)", str(error))
        if found:
            line = body.line(int(found[1]) + 1)
            raise MalformedLog(f"{name}, line {line}: a quotation mark is opened and not closed, remove it.") from error
        raise MalformedLog(f"{name}: the table cannot be read ({type(error).__name__}), export it again.") from error
    if len(frame) != len(body.lines):
        raise MalformedLog(f"{name}: a quotation mark is opened and not closed, remove it.")
    return plain_columns([frame[k].to_numpy() for k in range(width)])
