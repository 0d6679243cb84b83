"""Units as people write them, read by pint; of a parameter in a model file another unit is converted, or refused."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

from plant.errors import BadModelFile

# What pint would read as a number_meter.
_NEWTON_METRES = re.compile(r"(?<![A-Za-z])([mk]?)N([cm]?)m(s?)(?![A-Za-z])")
LONGEST = 40
"""Characters of a unit; beyond it, this is no unit but an accident."""
_POWER = re.compile(r"(?<=[A-Za-z])(\^|\*\*)-?\d(?![\d.])")  # of a unit, small: pint would compute 9**9**9 for hours
_OTHER_POWER = re.compile(r"\^|\*\*|\d\s*[⁰¹²³⁴⁵⁶⁷⁸⁹]")


_PRINTED = {"rad/rad": "cycles/rev", "-": ""}  # a number of periods in a turn; a number


def printed(unit: str) -> str:
    """A unit as people read it."""
    return _PRINTED.get(unit, unit)


def axis_quantities(axis: str) -> tuple[str, str, str, str]:
    """What moves and what drives it, each with its unit: an angle and a torque, on a linear axis position and force."""
    return ("position", "m", "force", "N") if axis == "linear" else ("angle", "rad", "torque", "N m")


def factor(unit: Any, own: str) -> float:
    """Factor that takes a number in `unit` to a parameter's own unit.

    Args:
        unit: as the file has it.
        own: of the parameter.

    Raises:
        BadModelFile: the unit is unknown, or measures another effect.
    """
    if not isinstance(unit, str):
        raise BadModelFile(f"the unit must be a text such as {own!r}, not {unit!r}")
    if unit.strip() == own:
        return 1.0
    try:
        return _converted(unit.strip(), own)
    except Exception:  # pint raises a dozen different types on odd text
        raise BadModelFile(f"the unit {unit[:LONGEST]!r} cannot be converted to {own!r}") from None


def _converted(unit: str, own: str) -> float:
    found, wanted = quantity(unit), quantity(own)
    if ("hertz" in str(found.units)) != ("hertz" in str(wanted.units)):  # turns a second: for pint radians a second
        raise ValueError(unit)
    number = float(found.to(wanted.units).magnitude)
    if not 0.0 < number < float("inf"):
        raise ValueError(unit)
    return number


def quantity(text: str) -> Any:
    """The `pint.Quantity` that a unit stands for, with its factor if it has one, as in "2.4 N m/1000".

    Raises whatever pint does on odd text, and `ValueError` for what it had better not try.
    """
    if not text or len(text) > LONGEST or _OTHER_POWER.search(_POWER.sub("", text)):
        raise ValueError(text)
    spelled = _NEWTON_METRES.sub(lambda found: f"{found[1]}N*{found[2]}m{'*s' * bool(found[3])}", text)
    registry = _registry()
    return registry.Quantity(1.0, "") * registry.parse_expression(spelled)


@cache
def _registry() -> Any:
    import pint  # slow to import, and most files have the parameters' own units

    return pint.UnitRegistry()
