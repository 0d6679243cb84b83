"""Lists in the cells of a text table, as pandas and ROS write them: `"[0.1, 0.2]"`, `"(0.1, 0.2)"`, `[0.1 0.2]`."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from identification.reading.formats.messages import Gathered, gathered

_LIST = re.compile(r"\s*[\[(].*[\])]\s*$", re.DOTALL)


def with_lists(columns: Mapping[str, NDArray[Any]]) -> Gathered:
    """The columns; a column with lists in its cells becomes one column per item, by joint if names are known."""
    lists = {name: values for name, values in columns.items() if _holds_lists(values)}
    if not lists:
        return Gathered(columns=dict(columns))
    rows = zip(*([_items(cell) for cell in values] for values in lists.values()), strict=True)
    found = gathered([dict(zip(lists, row, strict=True)) for row in rows])
    rest = {name: values for name, values in columns.items() if name not in lists}
    return Gathered(columns={**rest, **found.columns}, joint_of=found.joint_of)


def _holds_lists(values: NDArray[Any]) -> bool:
    if values.dtype.kind != "O":
        return False
    given = [cell for cell in values if isinstance(cell, str)]
    return bool(given) and all(map(_LIST.match, given))


def _items(cell: Any) -> list[Any]:
    """The items of a list in a cell, none if it is not a list of numbers or texts."""
    if not isinstance(cell, str):
        return []
    try:
        items = ast.literal_eval(cell.strip())
    except (ValueError, SyntaxError, MemoryError, RecursionError):  # NumPy has no commas
        items = re.split(r"[\s,;]+", cell.strip().strip("[]()").strip())
        try:
            return [float(item) for item in items]
        except ValueError:
            return []
    return [item for item in items if isinstance(item, str | int | float)] if isinstance(items, list | tuple) else []
