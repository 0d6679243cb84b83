"""Nested messages: their numbers with paths, and the joints in lists of names.

`{"drive": {"torque": 1.0}}` gives `drive.torque`; a list gives `torque:1`, `torque:2`, or `position:elbow` if the
message has a list of names of the same length (`name` of a ROS JointState, `joint_names`).
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

_LISTS_OF_NAMES = ("name", "names", "joint_names", "joints", "motor_names", "motors")
_LONGEST_LIST = 256  # a longer list is a picture or a scan, not the joints of a machine
_DEEPEST = 20
_PLAIN = {float, int, bool, str, type(None)}


@dataclass(frozen=True, kw_only=True)
class Leaf:
    """One value of a message. `quantity` is its path without the joint, if it belongs to one."""

    path: str
    value: float | str | None
    joint: str = ""
    quantity: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Gathered:
    """Columns with one value per message, NaN (or None in a text column) if the message does not have it.

    joint_of: column -> joint and quantity, as in `Table`.
    """

    columns: dict[str, NDArray[Any]] = field(default_factory=dict)
    joint_of: dict[str, tuple[str, str]] = field(default_factory=dict)


def gathered(messages: Sequence[Any], *, text: bool = True) -> Gathered:
    """One column for each value in any of the messages; without `text` numbers only."""
    plain, rest = _plain_columns(messages)
    found = _gathered(rest, text=text) if rest else Gathered()
    return replace(found, columns={key: v for key, v in plain.items() if text or v.dtype.kind == "f"} | found.columns)


def _plain_columns(messages: Sequence[Any]) -> tuple[dict[str, NDArray[Any]], list[Any]]:
    """The columns of fields that are plain in all messages, and the rest of the messages, if there is any."""
    if not all(isinstance(message, dict) for message in messages):
        return {}, list(messages)
    columns = {}
    nested = []
    for key in dict.fromkeys(key for message in messages for key in message):
        values = [message.get(key) for message in messages]
        if set(map(type, values)) <= _PLAIN:
            columns[str(key)] = column_of(values)
        else:
            nested.append(key)
    return columns, [{key: message[key] for key in nested if key in message} for message in messages] if nested else []


def _gathered(messages: Iterable[Any], *, text: bool) -> Gathered:
    known: dict[str, list[float | str | None]] = {}
    joint_of: dict[str, tuple[str, str]] = {}
    count = 0
    for message in messages:
        for leaf in leaves(message):
            if isinstance(leaf.value, str) and not text:
                continue
            values = known.setdefault(leaf.path, [])
            if len(values) > count:  # the message has this name twice
                continue
            values.extend([None] * (count - len(values)))
            values.append(leaf.value)
            if leaf.joint:
                joint_of[leaf.path] = (leaf.joint, leaf.quantity)
        count += 1
    for values in known.values():
        values.extend([None] * (count - len(values)))
    return Gathered(columns={path: column_of(values) for path, values in known.items()}, joint_of=joint_of)


def column_of(values: list[float | str | None]) -> NDArray[Any]:
    """Numbers as floats with NaN for None; a column with any text unchanged."""
    if any(isinstance(value, str) for value in values):
        return np.asarray(values, dtype=object)
    return np.asarray([np.nan if value is None else value for value in values], dtype=np.float64)


def leaves(message: Any, path: str = "", labels: tuple[str, ...] = (), depth: int = 0) -> Iterator[Leaf]:
    """The values of a message with their paths."""
    items = message if isinstance(message, Mapping | list | tuple) else _fields(message)
    if items is None:
        if message is None or isinstance(message, str | int | float | np.number | np.bool_):
            yield Leaf(path=path, value=message if isinstance(message, str | None) else float(message))
        return
    if depth > _DEEPEST:
        return
    if isinstance(items, Mapping):
        names, labels = names_in(items, labels)
        for key, value in items.items():
            if key != names:
                yield from leaves(value, f"{path}.{key}" if path else str(key), labels, depth + 1)
    elif len(items) == 1 and not labels:
        yield from leaves(items[0], path, (), depth + 1)
    elif len(items) <= _LONGEST_LIST:
        named = len(items) == len(labels)
        for k, value in enumerate(items):
            label = labels[k] if named else str(k + 1)
            for leaf in leaves(value, "", (), depth + 1):
                rest = f".{leaf.path}" if leaf.path and not leaf.path.startswith(":") else leaf.path
                yield Leaf(
                    path=f"{path}:{label}{rest}",
                    value=leaf.value,
                    joint=labels[k] if named else "",
                    quantity=f"{path}{rest}",
                )


def _fields(message: Any) -> Any:
    """Arrays as lists, objects as mappings of their fields; None for other values, such as numbers."""
    if isinstance(message, np.ndarray):
        return message.tolist() if message.ndim else None
    if isinstance(message, array):
        return message.tolist() if message.typecode not in "bB" else []
    if isinstance(message, bytes | bytearray | memoryview | str | int | float | np.generic) or message is None:
        return [] if isinstance(message, bytes | bytearray | memoryview) else None
    names = getattr(message, "__slots__", None) or getattr(message, "__dict__", {})
    return {name: getattr(message, name) for name in names if not name.startswith("_") and hasattr(message, name)}


def names_in(message: Mapping[Any, Any], labels: tuple[str, ...]) -> tuple[str, tuple[str, ...]]:
    """The key of the message's list of names, and the names; without one "" and `labels` of the outer message."""
    for key in _LISTS_OF_NAMES:
        names = message.get(key)
        if isinstance(names, list | tuple) and names and all(isinstance(name, str) and name for name in names):
            return key, tuple(names) if len(set(names)) == len(names) else ()
    return "", labels
