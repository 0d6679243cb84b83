"""Excel workbooks: the first sheet with a table of numbers, read as the text that it shows."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from datetime import datetime
from typing import Any

from identification.errors import MalformedLog
from identification.reading.formats.text import parse_text
from identification.reading.table import Table


def read_excel(content: bytes, name: str, sha256: str) -> Table:
    """The table of a workbook's first sheet that has one; names, units and lines are found as in a text file.

    Raises `MalformedLog` where no sheet has one.
    """
    from openpyxl import load_workbook

    book = load_workbook(io.BytesIO(content), read_only=True, data_only=True)
    refused: list[MalformedLog] = []
    for sheet in book.worksheets:
        text = io.StringIO()
        csv.writer(text, delimiter="\t", lineterminator="\n").writerows(
            [_cell(value) for value in row] for row in sheet.iter_rows(values_only=True)
        )
        try:
            table = parse_text(text.getvalue().encode(), name, sha256)
        except MalformedLog as error:
            refused.append(error)
            continue
        if len(book.worksheets) == 1:
            return table
        return replace(
            table, notes=(*table.notes, f"{name}: of {len(book.worksheets)} sheets, '{sheet.title}' is read")
        )
    raise refused[0] if refused else MalformedLog(f"{name}: the workbook holds no sheet, export it again.")


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return value.isoformat(sep=" ") if isinstance(value, datetime) else str(value)
