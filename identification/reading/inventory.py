"""The columns of a file: name, unit, range, and their actual or possible use."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.errors import MissingColumns
from identification.log_columns import COMMANDS, RESPONSES
from identification.reading.headings import heading
from identification.reading.joints import possible_joints
from identification.reading.reading_options import Reading
from identification.reading.recognition import Recognition, missing
from identification.reading.table import Table
from identification.reading.units import si_unit

_DATE = re.compile(r"\d[:/-]\d")  # a date, or a time of day
_LONGEST = 24  # characters of a text cell that are shown
_MOST = 60  # columns that a refusal lists


@dataclass(frozen=True, kw_only=True)
class ColumnFacts:
    """One column of a file.

    unit: as in the file; assumed: the assumed unit if the file has none.
    range: least and greatest value as text, for a column of text its first cell; samples: number of samples.
    used_as: the column of the log contract for which it is used, empty if it is not used; why: the reason.
    may_be: the possible column of the log contract, if it is not used.
    """

    name: str
    unit: str
    range: str
    samples: int
    used_as: str = ""
    why: str = ""
    may_be: str = ""
    assumed: str = ""


def inventory(table: Table, known: Recognition) -> tuple[ColumnFacts, ...]:
    """All columns of a table, in the order of the table."""
    columns = {name: column for column, name in known.found.items()}
    axis = "linear" if {"force", "position"} & set(known.found) else "rotary"
    return tuple(
        ColumnFacts(
            name=name,
            unit=table.units.get(name, "") or heading(name).unit,
            range=_range(values),
            samples=len(values),
            used_as=columns.get(name, ""),
            why=known.why.get(columns.get(name, ""), ""),
            may_be=known.guesses.get(name, ""),
            assumed="" if columns.get(name, "") in known.objects else _assumed(columns.get(name, ""), axis),
        )
        for name, values in table.columns.items()
    )


def refuse_missing(table: Table, known: Recognition, reading: Reading) -> None:
    """Raise `MissingColumns` if anything is missing: with all that is missing, and the columns of the file."""
    lacking = list(missing(known, table, reading))
    if not lacking:
        return
    facts = inventory(table, known)
    first = f"{table.name}: none of its columns is recognised as {_listed(lacking)}."
    options = suggested_options(table, known, lacking_time=lacking[0].startswith("'time'"))
    joints = possible_joints(table)
    choose = [f"If they are of {len(joints)} joints, choose one with --joint: {', '.join(joints)}."] if joints else []
    raise MissingColumns("\n".join([first, *lines(facts, most=_MOST), *choose]), options)


def suggested_options(table: Table, known: Recognition, *, lacking_time: bool) -> str:
    """Options with the best guess for each missing column, quoted for a shell; NAME without a guess."""
    needed: list[Sequence[str]] = []
    options = []
    taken = set(known.found.values())
    rising = [name for name, values in table.columns.items() if name not in taken and _rises(values)]
    if lacking_time and not rising:
        options.append("--rate HZ")
    elif lacking_time:
        needed.append(("time",))
    needed += [] if known.has_command else [COMMANDS]
    needed += [] if known.has_response else [RESPONSES]
    forced = "force" in {*known.found, *known.guesses.values()}
    for columns in needed:
        columns = columns[1:] if columns is RESPONSES and forced else columns
        guesses = ((column, name) for column in columns for name, may_be in known.guesses.items() if may_be == column)
        alone = rising[0] if columns == ("time",) and len(rising) == 1 else "NAME"
        column, guess = next(guesses, (columns[0], alone))
        options.append(f"--map {shlex.quote(f'{column}={guess}')}")
    return " ".join(options)


def _rises(values: NDArray[np.generic]) -> bool:
    """Whether a column may be a time: dates, or numbers that never decrease and are not just row numbers."""
    if values.dtype.kind not in "fiu":
        return values.dtype.kind == "M" or bool(values.size and _DATE.search(str(values[0])))
    numbers = values.astype(np.float64)
    steps = np.diff(numbers)
    return bool(np.all(steps >= 0) and np.any(steps > 0) and np.any(steps != 1))


def lines(facts: Sequence[ColumnFacts], most: int | None = None) -> list[str]:
    """The facts as a table, one line per column of the file; of more than `most` those with a use come first."""
    if most is not None and len(facts) > most:
        listed = sorted(facts, key=lambda one: not _use(one))[:most]
        return [*lines(listed), f"  and {len(facts) - most} other columns"]
    shown = [(one.name, one.unit or one.assumed, one.range, _use(one)) for one in facts]
    rows = [("column", "unit", "range", "used as"), *shown]
    widths = [max(len(row[place]) for row in rows) for place in range(4)]
    return ["  " + "  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]


def _assumed(column: str, axis: str) -> str:
    """The assumed unit of a used column without a unit, in brackets; none for a time, which may have any unit."""
    return "" if column in ("", "time", "run", "duty") else f"({si_unit(column, axis)})"


def _use(one: ColumnFacts) -> str:
    if one.used_as:
        return f"{one.used_as} ({one.why})"
    return f"{one.may_be}?" if one.may_be else ""


def _listed(words: list[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def _range(values: NDArray[np.generic]) -> str:
    if values.dtype.kind in "fiub":
        sound = values[np.isfinite(values)] if values.dtype.kind == "f" else values
        return f"{float(sound.min()):.4g} .. {float(sound.max()):.4g}" if sound.size else "no numbers"
    first = next((str(cell) for cell in values if str(cell) not in ("", "nan", "None", "NaT")), "")
    return f"'{first[:_LONGEST]}' ..." if first else "empty"
