"""Excel workbooks: the first sheet with a table of numbers, read as text; sheets with equal columns are runs."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from typing import Any

import numpy as np

from identification.errors import MalformedLog
from identification.reading.formats.text import parse_text
from identification.reading.table import Table


def read_excel(content: bytes, name: str, sha256: str) -> Table:
    """The first table in the sheets of a workbook, or all tables if they are alike, read as in a text file.

    Raises `MalformedLog` if no sheet has a table.
    """
    from openpyxl import load_workbook

    book = load_workbook(io.BytesIO(content), read_only=True, data_only=True)
    refused: list[MalformedLog] = []
    found: dict[str, Table] = {}
    for sheet in book.worksheets:
        text = io.StringIO()
        csv.writer(text, delimiter="\t", lineterminator="\n").writerows(
            [_cell(value) for value in row] for row in sheet.iter_rows(values_only=True)
        )
        try:
            found[sheet.title] = parse_text(text.getvalue().encode(), name, sha256)
        except MalformedLog as error:
            refused.append(error)
    if not found:
        raise refused[0] if refused else MalformedLog(f"{name}: the workbook holds no sheet, export it again.")
    title, first = next(iter(found.items()))
    if len(book.worksheets) == 1:
        return first
    if len(found) > 1 and _same_columns(list(found.values())):
        return _as_runs(found)
    return replace(first, notes=(*first.notes, f"{name}: of {len(book.worksheets)} sheets, '{title}' is read"))


def _same_columns(tables: Sequence[Table]) -> bool:
    """Whether sheets have the same columns in the same units, without runs, clocks or joints."""
    one = tables[0]
    same = all(list(table.columns) == list(one.columns) and table.units == one.units for table in tables)
    return same and "run" not in one.columns and not any(table.clocks or table.joint_of for table in tables)


def _as_runs(sheets: Mapping[str, Table]) -> Table:
    """The sheets one below the other; each is an experiment with the name of the sheet."""
    one, *_ = sheets.values()
    columns = {key: np.concatenate([table.columns[key] for table in sheets.values()]) for key in one.columns}
    lengths = [len(next(iter(table.columns.values()))) for table in sheets.values()]
    listed = ", ".join(f"'{title}'" for title in sheets)
    notes = (*one.notes, f"{one.name}: the sheets {listed} have the same columns, and are runs")
    run = np.repeat(np.asarray(list(sheets), dtype=object), lengths)
    return Table(name=one.name, columns={**columns, "run": run}, sha256=one.sha256, units=one.units, notes=notes)


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return value.isoformat(sep=" ") if isinstance(value, datetime) else str(value)
