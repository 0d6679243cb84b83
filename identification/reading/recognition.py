"""Recognise the columns of a table: as mapped, by their contract name, as a drive's object, or by meaning.

If several columns are possible, none is used: the user must choose one. A requested value (a target) is used only if
there is no measured one.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.log_columns import (
    ALIASES,
    COLUMNS,
    COMMANDS,
    CURRENTS_OF_TWO,
    RESPONSES,
    SINGLE_COMMANDS,
    TORQUES_OF_TWO,
)
from identification.reading.cia402 import find_objects
from identification.reading.column_meaning import AMONG_OTHERS, COMMANDED, OWN, SYNONYM, Meaning, meaning
from identification.reading.headings import heading
from identification.reading.join import has_clock, join_rows, join_tables, qualified
from identification.reading.reading_options import Reading
from identification.reading.table import Table
from identification.reading.units import kind_of

_PAIRS = (TORQUES_OF_TWO, CURRENTS_OF_TWO)
_OF_TWO = frozenset((*TORQUES_OF_TWO, *CURRENTS_OF_TWO))
AS_GIVEN = "as given"
_OPTIONAL = ("velocity", "run")  # used only if their name has no other meaning


@dataclass
class Recognition:
    """The use of the columns of a table.

    found: contract column -> the table's column.
    why: contract column -> the reason, for messages.
    guesses: the table's column -> possible contract column, for columns that are not used.
    objects: contract columns that were found as objects of CiA 402.
    """

    found: dict[str, str] = field(default_factory=dict)
    why: dict[str, str] = field(default_factory=dict)
    guesses: dict[str, str] = field(default_factory=dict)
    objects: tuple[str, ...] = ()

    def take(self, column: str, name: str, why: str) -> None:
        """Use the table's column `name` as the contract column `column`."""
        self.found[column], self.why[column] = name, why

    @property
    def has_command(self) -> bool:
        """Whether there is a command."""
        found = set(self.found)
        return bool(found.intersection(SINGLE_COMMANDS)) or any(found.issuperset(pair) for pair in _PAIRS)

    @property
    def has_response(self) -> bool:
        """Whether there is the motion of the load."""
        return bool(set(self.found) & set(RESPONSES))


def recognise(table: Table, reading: Reading) -> Recognition:
    """The use of the columns of a table.

    Raises `MalformedLog` for a mapped column that the table does not have, for one that is mapped to both the command
    and the response, and if two objects of a drive are possible.
    """
    known = Recognition()
    for column, wanted in reading.mapping.items():
        if column == "time" and table.clocks and wanted not in table.columns:
            continue  # it was that of the files before they were joined
        known.take(column, _named(table, column, wanted), AS_GIVEN)
    _refuse_twice(table, known)
    taken = {*known.found.values(), *table.joint_of}  # of several joints the user has named the columns
    left = {name: table.units.get(name, "").strip() for name in table.columns if name not in taken}
    for name in list(left):
        own = _own_name(name)
        if own is None or own in known.found or (own == "position" and _is_angle(known, name, left)):
            continue
        known.take(own, name, "named so")
        del left[name]
    linear = any(column in given for column in ("force", "position") for given in (known.found, reading.units))
    # the number of a column without a name is not the index of an object
    named = [name for place, name in enumerate(table.columns, start=1) if name in left and name != str(place)]
    objects = find_objects(table.name, named, known.found, linear=linear)
    for column, name in objects.items():
        known.take(column, name, "an object of CiA 402")
        del left[name]
    known.objects = tuple(objects)
    meant = {name: found for name, unit in left.items() if (found := meaning(name, unit)) is not None}
    meant = {name: _on_axis(known, found, meant, linear) for name, found in meant.items()}
    meant = _without_idle(table, meant)
    _take_by_meaning(known, meant)
    _leave_out_needless(table, known)
    taken = set(known.found.values())
    known.guesses = {name: found.column for name, found in meant.items() if name not in taken}
    return known


def _without_idle(table: Table, meant: Mapping[str, Meaning]) -> dict[str, Meaning]:
    """The possible meanings without columns that never change, where another column for the same use changes.

    A sensor or a channel that is not connected is exported all the same. Of two torques one may rest, and so may one of
    several joints, whose names differ by a number: these are left to the user.
    """
    moving: dict[str, set[str]] = {}
    for name, found in meant.items():
        if _changes(table.columns[name]):
            moving.setdefault(found.column, set()).add(_without_number(name))
    return {
        name: found
        for name, found in meant.items()
        if found.column in ("torque", "force")
        or _changes(table.columns[name])
        or not moving.get(found.column, set()) - {_without_number(name)}
    }


def _without_number(name: str) -> str:
    return re.sub(r"\d+", "#", name)


def _leave_out_needless(table: Table, known: Recognition) -> None:
    """Leave out a command beside another one that changes, if it never changes or is of another kind of axis."""
    given = {column for column in COMMANDS if known.why.get(column) == AS_GIVEN}
    found = [column for column in COMMANDS if column in known.found]
    changing = {column for column in found if column in given or _changes(table.columns[known.found[column]])}
    other_axis = {"force"} if "angle" in known.found else {"torque", *_OF_TWO}
    if not {"angle", "position"} & set(known.found) or {"angle", "position"} <= set(known.found):
        other_axis = set()
    pairs = {column for pair in _PAIRS if changing.intersection(pair) for column in pair}
    for column in set(found) - given - pairs:
        if changing - {column} - other_axis and (column not in changing or column in other_axis):
            del known.found[column], known.why[column]


def _changes(values: NDArray[Any]) -> bool:
    if values.dtype.kind not in "fiub":
        return True
    sound = values[np.isfinite(values)] if values.dtype.kind == "f" else values
    return bool(sound.size and sound.min() < sound.max())


def _refuse_twice(table: Table, known: Recognition) -> None:
    """Raise `MalformedLog` for a column that is mapped to both the command and the response."""
    names = {known.found[column]: column for column in COMMANDS if column in known.found}
    for column in RESPONSES:
        name = known.found.get(column)
        if name in names:
            raise MalformedLog(
                f"{table.name}: '{name}' is mapped to both '{names[name]}' and '{column}'; name another column."
            )


def _named(table: Table, column: str, wanted: str) -> str:
    if wanted in table.columns:
        return wanted
    names = list(table.columns)
    if re.fullmatch(r"\d+", wanted) and 1 <= int(wanted) <= len(names):
        return names[int(wanted) - 1]
    matching = [name for name in names if name.strip().lower() == wanted.strip().lower()]
    if len(matching) == 1:
        return matching[0]
    raise MalformedLog(
        f"{table.name}: there is no column '{wanted}' to use as '{column}', the file has "
        f"{', '.join(repr(name) for name in names)}."
    )


def _own_name(name: str) -> str | None:
    """The contract column with the name of a heading, apart from case, spaces, `_` and a unit; else None."""
    for plain in (name.strip().lower(), "_".join(heading(name).words)):
        if (column := ALIASES.get(plain, plain)) in COLUMNS:
            return column
    return None


def _is_angle(known: Recognition, name: str, left: Mapping[str, str]) -> bool:
    """Whether a column called "position" is the angle of a rotary axis: from its unit, else from the command."""
    unit = left[name] or heading(name).unit
    found = meaning(name, unit)
    if found is not None and found.column == "angle":
        return True
    if found is not None and kind_of(found.unit) is not None:
        return False
    others = {m.column for one in left if one != name and (m := meaning(one, left[one])) is not None}
    rotary = {"torque", "current", "voltage", *_OF_TWO}
    return not {"force"} & (others | set(known.found)) and bool(rotary & (others | set(known.found)))


def _on_axis(known: Recognition, found: Meaning, meant: Mapping[str, Meaning], linear: bool) -> Meaning:
    """A position without a unit is an angle, unless the command is a force."""
    if found.column != "position" or kind_of(found.unit) is not None:
        return found
    forced = linear or "force" in known.found or any(other.column == "force" for other in meant.values())
    return found if forced else Meaning(column="angle", grade=found.grade, unit=found.unit)


def _take_by_meaning(known: Recognition, meant: Mapping[str, Meaning]) -> None:
    """For each missing contract column use the column with the highest grade, if it is the only one of that grade."""
    _take_shafts(known, meant)
    wanted = ["time"] if "time" not in known.found else []
    if not {"angle", "position"} & set(known.found):
        wanted += ["angle", "position"]
    for column in wanted:
        _take(known, column, meant)
    if not known.has_response:
        _take(known, "velocity", meant)
    if not known.has_command:
        _take_command(known, meant)
    for column in _OPTIONAL:
        if column not in known.found:
            _take(known, column, {name: found for name, found in meant.items() if found.grade >= SYNONYM})


def _take_command(known: Recognition, meant: Mapping[str, Meaning]) -> None:
    linear = "position" in known.found
    for column in ("force" if linear else "torque", "current", "voltage", "duty", "setpoint"):
        if _take(known, column, meant):
            return
        if column == "torque" and (pair := _pair(meant)) is not None:
            for place, name in enumerate(pair, start=1):
                known.take(f"torque_{place}", name, "a torque, one of two")
            return
        if any(found.column == column for found in meant.values()):
            return  # several are possible: no other kind of command is used instead


def _take(known: Recognition, column: str, meant: Mapping[str, Meaning]) -> bool:
    taken = set(known.found.values())
    for grade in (OWN, SYNONYM, AMONG_OTHERS, COMMANDED):
        matching = [
            name
            for name, found in meant.items()
            if found.column == column and found.grade == grade and name not in taken
        ]
        if len(matching) == 1:
            known.take(column, matching[0], "by name" if grade > AMONG_OTHERS else "by name, the only one")
        if matching:
            return len(matching) == 1
    return False


def _take_shafts(known: Recognition, meant: Mapping[str, Meaning]) -> None:
    """With torques of two motors, angles named with 1 and 2 are those of the shafts, if another angle is the load's."""
    angles = [name for name, found in meant.items() if found.column == "angle"]
    pairs = [two for one in angles for other in angles if (two := _one_and_two(one, other))]
    two_motors = any(known.found.keys() >= set(pair) for pair in _PAIRS) or _pair(meant) is not None
    if not two_motors or len(pairs) != 1 or len(angles) < 3 or {"angle_1", "angle_2"} & set(known.found):
        return
    for place, name in enumerate(pairs[0], start=1):
        known.take(f"angle_{place}", name, "an angle, one of two motors'")


def _pair(meant: Mapping[str, Meaning]) -> tuple[str, str] | None:
    """The torques of two motors: the only two torques, with names that differ by 1 and 2.

    Two currents may be those of two phases.
    """
    names = [name for name, found in meant.items() if found.column == "torque"]
    return _one_and_two(*sorted(names)) if len(names) == 2 else None


def _one_and_two(one: str, two: str) -> tuple[str, str] | None:
    """Two names, if their only difference is a 1 in the first and a 2 in the second."""
    differ = [(a, b) for a, b in zip(_split(one), _split(two), strict=False) if a != b]
    return (one, two) if len(_split(one)) == len(_split(two)) and differ == [("1", "2")] else None


def _split(name: str) -> list[str]:
    return re.findall(r"\d+|\D+", name)


def missing(known: Recognition, table: Table, reading: Reading) -> Iterator[str]:
    """The missing columns of a log, in words."""
    if "time" not in known.found and not table.clocks and reading.rate is None:
        yield "'time' (or, with --rate HZ, none)"
    if not known.has_command:
        one = "'torque', 'current', 'voltage', 'duty' or 'setpoint'"
        yield f"the command ({one}; of two motors 'torque_1' and 'torque_2', or 'current_1' and 'current_2')"
    unclear = known.why.get("velocity") != AS_GIVEN and {"angle", "position"} & set(known.guesses.values())
    if not known.has_response or (unclear and not {"angle", "position"} & set(known.found)):
        yield "the response ('angle', 'position' or 'velocity')"


def joined_if_needed(tables: Sequence[Table], reading: Reading) -> list[Table]:
    """The tables; joined if one of two has the command and the other the response, or if a mapped name has a file's.

    Files without a time are joined row by row, the others on their clocks.

    Raises `MalformedLog` if the files do not fit together, or if it is unclear which of them has a mapped column.
    """
    if len(tables) < 2 or any(table.joints for table in tables):
        return list(tables)
    time = reading.mapping.get("time")
    full = {qualified(table, name) for table in tables for name in table.columns}
    wanted = {name for name in reading.mapping.values() if name in full} - {n for t in tables for n in t.columns}
    if wanted:
        by_row = time in wanted or not any(has_clock(table, time) for table in tables)
        return [join_rows(tables, wanted) if by_row else join_tables(tables, time, wanted)]
    _refuse_unclear(tables, reading)
    if len(tables) != 2:
        return list(tables)
    parts = []
    for table in tables:
        own = {column: name for column, name in reading.mapping.items() if name in table.columns}
        parts.append(recognise(table, replace(reading, mapping=own)))
    one, other = parts
    apart = one.has_command != other.has_command and one.has_response != other.has_response
    if apart and one.has_command != one.has_response:
        by_row = reading.rate is not None and not any(has_clock(table, time) for table in tables)
        return [join_rows(tables) if by_row else join_tables(tables, time)]
    return list(tables)


def _refuse_unclear(tables: Sequence[Table], reading: Reading) -> None:
    """Raise `MalformedLog` for one name that is mapped to command and response, and that several files have."""
    for command in (column for column in COMMANDS if column in reading.mapping):
        name = reading.mapping[command]
        response = next((column for column in RESPONSES if reading.mapping.get(column) == name), None)
        if response is None or not all(name in table.columns for table in tables):
            continue
        one, other = (shlex.quote(qualified(table, name)) for table in tables[:2])
        raise MalformedLog(
            f"'{name}' is mapped to both '{command}' and '{response}'; if these are columns of two files, put the name "
            f"of the file before each, for example --map {command}={one} --map {response}={other}."
        )
