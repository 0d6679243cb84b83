"""Units as text, parsed by pint; the unit of a parameter in a model file is converted, or refused."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

from plant.errors import BadModelFile

# Units that pint would parse as number metres.
_NEWTON_METRES = re.compile(r"(?<![A-Za-z])([mk]?)N([cm]?)m(s?)(?![A-Za-z])")
LONGEST = 40
"""Most characters of a unit; longer texts are refused."""
_POWER = re.compile(r"(?<=[A-Za-z])(\^|\*\*)-?\d(?![\d.])")  # small power: pint would compute 9**9**9 for hours
_OTHER_POWER = re.compile(r"\^|\*\*|\d\s*[⁰¹²³⁴⁵⁶⁷⁸⁹]")


_PRINTED = {"rad/rad": "cycles/rev", "-": ""}  # a number of periods per turn; a number


def printed(unit: str) -> str:
    """A unit as printed for users."""
    return _PRINTED.get(unit, unit)


def axis_quantities(axis: str) -> tuple[str, str, str, str]:
    """Names and units of motion and drive: angle and torque, on a linear axis position and force."""
    return ("position", "m", "force", "N") if axis == "linear" else ("angle", "rad", "torque", "N m")


def factor(unit: Any, own: str) -> float:
    """Factor that converts a number in `unit` to a parameter's own unit.

    Args:
        unit: as in the file.
        own: of the parameter.

    Raises:
        BadModelFile: the unit is unknown, or measures another quantity.
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
    if ("hertz" in str(found.units)) != ("hertz" in str(wanted.units)):  # pint takes turns as radians
        raise ValueError(unit)
    number = float(found.to(wanted.units).magnitude)
    if not 0.0 < number < float("inf"):
        raise ValueError(unit)
    return number


def quantity(text: str) -> Any:
    """The `pint.Quantity` of a unit, with its factor if it has one, as in "2.4 N m/1000".

    Raises any error of pint on invalid text, and `ValueError` for text that is not passed to pint.
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
