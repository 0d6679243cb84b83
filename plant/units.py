"""Units in a model file: another one than the parameter's own is converted, or refused."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

from plant.errors import BadModelFile

_NEWTON_METRES = re.compile(r"(?<![A-Za-z])([mk]?)N([cm]?)m(?![A-Za-z])")  # pint would read a number_meter
_LONGEST = 40  # characters; beyond it, this is no unit but an accident
_POWER = re.compile(r"(?<=[A-Za-z])(\^|\*\*)-?\d(?![\d.])")  # of a unit, small: pint would compute 9**9**9 for hours


def factor(unit: Any, own: str) -> float:
    """Factor that takes a number in `unit` to a parameter's own unit.

    Args:
        unit: as the file has it.
        own: of the parameter.

    Raises:
        BadModelFile: the unit is unknown, or measures something else.
    """
    if not isinstance(unit, str):
        raise BadModelFile(f"the unit must be a text such as {own!r}, not {unit!r}")
    if unit.strip() == own:
        return 1.0
    try:
        return _converted(unit.strip(), own)
    except Exception:  # pint raises a dozen different types on odd text
        raise BadModelFile(f"the unit {unit[:_LONGEST]!r} cannot be converted to {own!r}") from None


def _converted(unit: str, own: str) -> float:
    if not unit or len(unit) > _LONGEST or re.search(r"\^|\*\*", _POWER.sub("", unit)):
        raise ValueError(unit)
    registry = _registry()
    found, wanted = (registry.parse_units(_NEWTON_METRES.sub(r"\1N*\2m", text)) for text in (unit, own))
    if ("hertz" in str(found)) != ("hertz" in str(wanted)):  # turns a second: for pint as much as radians a second
        raise ValueError(unit)
    number = float(registry.Quantity(1.0, found).to(wanted).magnitude)
    if not 0.0 < number < float("inf"):
        raise ValueError(unit)
    return number


@cache
def _registry() -> Any:
    import pint  # slow to import, and most files have the parameters' own units

    return pint.UnitRegistry()
