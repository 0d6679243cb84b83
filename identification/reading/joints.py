"""Logs of machines with several joints: the joint of each column, and the columns of one joint."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Collection, Mapping
from dataclasses import replace
from difflib import get_close_matches
from typing import Any

import numpy as np

from identification.errors import MalformedLog
from identification.reading.column_meaning import meaning
from identification.reading.table import Table
from plant.errors import BadParameter

_PATH = re.compile(r"(?P<topic>/.*)/(?P<joint>[^/]+)/(?P<quantity>position|velocity|effort)")  # PlotJuggler
_LISTED = re.compile(r"(?P<field>.*[./])?(?P<quantity>position|velocity|effort)(?P<place>_?\d+|\[\d+\])")
_FLAT = re.compile(r"(?P<joint>.+_joint)_(?P<quantity>position|velocity|effort|torque)")  # elbow_joint_position
_NUMBERED = re.compile(r"(?P<quantity>[A-Za-z]+):(?P<joint>\d+)")  # columns of a matrix, as of an NPZ file
_COUNTED = re.compile(r"(?P<quantity>.*[A-Za-z])[ _]*[(\[]?(?P<joint>\d+)[)\]]?")  # Position1 to Position7, pos (4)
_QUANTITIES = {
    **dict.fromkeys(("position", "positions", "pos", "q"), "position"),
    **dict.fromkeys(("velocity", "velocities", "vel", "qd", "dq"), "velocity"),
    **dict.fromkeys(("effort", "efforts", "torque", "torques", "tau"), "effort"),
    **dict.fromkeys(("current", "currents", "cur"), "current"),
}
_FEWEST = 3  # joints of counted columns; two may be the two motors of one axis, and are joints if the user says so
_KINDS = {"angle": "position", "position": "position", "torque": "effort", "current": "current"}


def with_joints(table: Table) -> Table:
    """The table with the joints in its column names: `/joint_states/elbow/position`, `field.position0`, `torques:2`."""
    if table.joint_of:
        return table
    names = table.columns
    joint_of = _in_paths(names) or _in_names(names, _FLAT) or _in_names(names, _NUMBERED) or _in_counted(names, _FEWEST)
    for name in table.columns:
        if found := _LISTED.fullmatch(name):  # rostopic echo -p
            joint = _constant(table.columns.get(f"{found['field'] or ''}name{found['place']}"))
            if joint:
                joint_of[name] = (joint, f"{found['field'] or ''}{found['quantity']}")
    return replace(table, joint_of=joint_of) if joint_of else table


def _in_paths(names: Collection[str]) -> dict[str, tuple[str, str]]:
    """The joints in the paths of PlotJuggler: parts of one topic with a common quantity.

    A part with an encoder's position and a part with a drive's effort have none in common, so they are not joints.
    """
    found = {name: match for name in names if (match := _PATH.fullmatch(name))}
    topics: dict[str, dict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    for match in found.values():
        topics[match["topic"]][match["joint"]].add(match["quantity"])
    joined = {topic for topic, joints in topics.items() if set.intersection(*joints.values())}
    return {
        name: (match["joint"], f"{match['topic']}.{match['quantity']}")
        for name, match in found.items()
        if match["topic"] in joined
    }


def _in_names(names: Collection[str], pattern: re.Pattern[str]) -> dict[str, tuple[str, str]]:
    """The joints in names of one pattern: two or more, each with a position and an effort, and all with the same."""
    found = {name: match for name in names if (match := pattern.fullmatch(name))}
    joint_of = {
        name: (match["joint"], _QUANTITIES[match["quantity"].lower()])
        for name, match in found.items()
        if match["quantity"].lower() in _QUANTITIES
    }
    joints: dict[str, set[str]] = defaultdict(set)
    for joint, quantity in joint_of.values():
        joints[joint].add(quantity)
    same_names = len({frozenset(each) for each in joints.values()}) == 1
    return joint_of if len(joints) > 1 and same_names and {"position", "effort"} <= set.union(*joints.values()) else {}


def _in_counted(names: Collection[str], fewest: int) -> dict[str, tuple[str, str]]:
    """The joints in names that end in their number: each with a position and an effort or a current."""
    found = {name: match for name in names if (match := _COUNTED.fullmatch(name))}
    numbers: dict[str, set[str]] = defaultdict(set)
    for match in found.values():
        numbers[match["quantity"]].add(match["joint"])
    kinds = {quantity: kind for quantity in numbers if (kind := _kind(quantity)) is not None}
    if "position" not in kinds.values() or not {"effort", "current"} & set(kinds.values()):
        return {}
    joints = set.intersection(*(numbers[quantity] for quantity in kinds))
    of_all = {quantity for quantity, counted in numbers.items() if joints <= counted}
    return {
        name: (match["joint"], _QUANTITIES.get(match["quantity"].lower(), match["quantity"]))
        for name, match in found.items()
        if len(joints) >= fewest and match["joint"] in joints and match["quantity"] in of_all
    }


def _kind(quantity: str) -> str | None:
    """What a column measures by its name without the number; None if that is no quantity of a joint."""
    found = meaning(quantity, "")
    return _QUANTITIES.get(quantity.lower()) or (None if found is None else _KINDS.get(found.column))


def select_joint(table: Table, joint: str | None = None, mapped: Collection[str] = ()) -> Table:
    """The table with the columns of one joint, named without it (`position:elbow` as `position`), and those of none.

    mapped: columns that the user named; they keep their names, and if one belongs to a joint, `joint` is not needed.

    Raises `BadParameter` if the table has no such joint, and `MalformedLog` if the user must choose one.
    """
    if joint is not None and not table.joints:
        table = replace(table, joint_of=_in_counted(table.columns, 2))
    joints = table.joints
    if joint is None and (not joints or any(name in table.joint_of for name in mapped)):
        return table
    if joint is None:
        if len(joints) > 1:
            raise MalformedLog(
                f"{table.name}: the log has {len(joints)} joints, choose one with --joint NAME: {', '.join(joints)}."
            )
        joint = joints[0]
    if joint not in joints:
        raise BadParameter(_unknown(table.name, joint, joints))
    own = {name: what for name, (whose, what) in table.joint_of.items() if whose == joint}
    short = _shortened(own, [name for name in table.columns if name not in table.joint_of])
    called = {
        name: short.get(name, name) if name not in mapped else name
        for name in table.columns
        if name in own or name in mapped or name not in table.joint_of
    }
    return replace(
        table,
        columns={new: table.columns[old] for old, new in called.items()},
        clocks={called[old]: clock for old, clock in table.clocks.items() if old in called},
        units={called.get(old, old): unit for old, unit in table.units.items() if old in called or old == "time"},
        joint_of={},
    )


def possible_joints(table: Table) -> tuple[str, ...]:
    """The two joints of a table whose counted columns may also be those of two motors of one axis."""
    return () if table.joint_of else replace(table, joint_of=_in_counted(table.columns, 2)).joints


def _unknown(name: str, joint: str, joints: Collection[str]) -> str:
    if not joints:
        return f"{name}: there are no joints in this log, leave out --joint {joint}."
    near = get_close_matches(joint, joints, n=1)
    return f"{name}: there is no joint '{joint}', " + (
        f"is it '{near[0]}'?" if near else f"the log has {', '.join(joints)}."
    )


def _shortened(own: Mapping[str, str], others: Collection[str]) -> dict[str, str]:
    """The quantities without their topic, if they are unique without it."""
    short = {name: re.sub(r"^(/([^/]*/)*[^/.]*|field)\.", "", quantity) for name, quantity in own.items()}
    times = Counter([*short.values(), *others])
    return {name: short[name] if times[short[name]] == 1 else quantity for name, quantity in own.items()}


def _constant(values: Any) -> str:
    """The text of a column with a single text, else ""."""
    if values is None:
        return ""
    found = {str(value) for value in np.asarray(values[:50], dtype=object)}
    return found.pop() if len(found) == 1 else ""
