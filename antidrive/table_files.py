"""Files with tables and numbers for a drive: CSV, and C arrays in a header."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plant.drive_table import DriveTable
from plant.inverse import time_lead
from plant.model_file import ModelFile
from plant.uncertain_number import measured

_ROUNDING = 1e-12  # of the largest value
ARCMIN = 60.0 * 180.0 / np.pi
NUMBERS = {"backlash": ("backlash",), "dead-time": ("input_delay", "actuator_lag")}
"""Tables that are numbers, and the effects with these parameters."""


@dataclass(frozen=True, kw_only=True)
class Number:
    """One number of a drive: value and standard error in a unit, None if the error is unknown."""

    name: str
    value: float
    std: float | None
    unit: str

    def __str__(self) -> str:
        """Text in one line."""
        unit = self.unit.removesuffix("-")
        number = f"{self.value:.6g} {unit}".rstrip() if self.std is None else measured(self.value, self.std, unit)
        return f"{self.name} = {number}"


def numbers_of(read: ModelFile, kind: str) -> list[Number]:
    """Backlash, or dead time, of a model; empty if it has none."""
    specs = {spec.name: spec for spec in read.model.parameters}
    found = [
        Number(name=name.replace(".", "_"), value=float(value), std=read.std.get(name), unit=specs[name].unit)
        for name, value in zip(read.model.names, read.model.values, strict=True)
        if name.split(".")[0] in NUMBERS[kind]
    ]
    for backlash in [number for number in found if number.name == "backlash_gap" and number.unit == "rad"]:
        std = None if backlash.std is None else ARCMIN * backlash.std
        found.append(Number(name="backlash_gap_arcmin", value=ARCMIN * backlash.value, std=std, unit="arcmin"))
    if found and kind == "dead-time":
        found.append(Number(name="lead", value=time_lead(read.model), std=None, unit="s"))
    return found


def csv_text(columns: Mapping[str, Any], units: Mapping[str, str]) -> str:
    """A table as CSV with the units in its headings."""
    heads = [f"{name} [{units[name]}]" if units.get(name) else name for name in columns]
    rows = zip(*columns.values(), strict=True)
    return "\n".join([",".join(heads), *(",".join(_cell(cell) for cell in row) for row in rows)]) + "\n"


def c_table(table: DriveTable, *, single: bool) -> str:
    """The columns as C arrays in a header."""
    name, real = f"antidrive_{table.kind.replace('-', '_')}", "float" if single else "double"
    count = f"{name}_points".upper()
    lines = [f"#define {count} {table.points}", ""]
    for column, values in table.columns.items():
        body = ", ".join(f"{_decimal(value)}{'f' if single else ''}" for value in values)
        lines.append(f"static const {real} {name}_{column}[{count}] = {{ /* {table.units[column]} */")
        lines += [*_wrapped(body), "};", ""]
    last = table.ends[1]
    header_lines = [f"{last}: {table.meaning}.", *summary_line(table)]
    return _header(name, header_lines, lines)


def c_numbers(kind: str, numbers: Sequence[Number], *, single: bool) -> str:
    """The numbers as macros in a header."""
    name = f"antidrive_{kind.replace('-', '_')}"
    end = "f" if single else ""
    lines = [f"#define ANTIDRIVE_{n.name.upper()} {_decimal(n.value)}{end} /* {n.unit} */" for n in numbers]
    return _header(name, [f"{kind.replace('-', ' ').capitalize()} of a servo."], [*lines, ""])


def summary_line(table: DriveTable) -> list[str]:
    """Harmonics, notes and the error of linear interpolation, a sentence each."""
    first, last = table.ends
    unit = table.units[first].split("/")[0]
    found = [
        f"Harmonic with {_order(order, unit)}: amplitude {size:.4g} {table.units[last]}, phase {phase:.4g} rad at zero."
        for order, size, phase in table.harmonics
    ]
    exact = table.largest_error <= _ROUNDING * float(np.max(np.abs(table.columns[last])))
    error = f"The largest error of linear interpolation is {table.largest_error:.2g} {table.units[last]}."
    error = "Linear interpolation is exact." if exact else error
    return [*found, *table.notes, error]


def _order(order: float, unit: str) -> str:
    number = f"{order:.6g}"
    return f"{number} rad/{unit}" if unit != "rad" else f"{number} cycle{'s' * (number != '1')}/rev"


def _header(name: str, notes: Sequence[str], lines: Sequence[str]) -> str:
    guard = f"{name}_H".upper()
    begin = [f"/* {name}.h", *(f" * {line}" for line in notes), " */", f"#ifndef {guard}", f"#define {guard}", ""]
    return "\n".join([*begin, *lines, "#endif", ""])


def _decimal(value: float) -> str:
    text = f"{value:.9g}"
    return text if "." in text or "e" in text else f"{text}.0"


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, 100, initial_indent="    ", subsequent_indent="    ")


def _cell(value: Any) -> str:
    return value if isinstance(value, str) else "" if value is None else f"{float(value):.9g}"
