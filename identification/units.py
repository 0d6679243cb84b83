"""Conversion of log columns to SI, at the edge and nowhere else."""

from __future__ import annotations

from functools import cache
from typing import Any

from plant.errors import BadParameter

# What each column of the log contract is measured in.
SI_UNITS = {
    "time": "s",
    "torque": "N m",
    "torque_1": "N m",
    "torque_2": "N m",
    "force": "N",
    "angle": "rad",
    "angle_1": "rad",
    "angle_2": "rad",
    "position": "m",
}

# Columns whose unit follows the axis: an angle on a rotary axis, a length on a linear one.
AXIS_UNITS = {"velocity": ("rad/s", "m/s"), "reference": ("rad", "m"), "goal": ("rad", "m")}

_SPELLINGS = {"Nm": "N*m", "mNm": "mN*m", "kNm": "kN*m", "Ncm": "N*cm", "N m": "N*m", "mN m": "mN*m"}

# These are numbers for pint, so it would take them for radians; how much they are is known to the user alone.
_BARE_NUMBERS = {"count", "percent", "permille", "ppm", "dimensionless", "bit", "byte"}


@cache
def _registry() -> Any:
    import pint  # slow to import, and most logs are in SI already

    return pint.UnitRegistry()


def si_unit(column: str, axis: str) -> str:
    """The SI unit of a contract column on a "rotary" or "linear" axis."""
    if column in AXIS_UNITS:
        return AXIS_UNITS[column][axis == "linear"]
    return SI_UNITS[column]


def si_factor(column: str, unit: str, axis: str) -> float:
    """Factor that takes values in `unit` to the SI unit of `column`.

    Raises `BadParameter` when the unit is unknown, measures something else, or is a bare number
    (counts, per mille) whose size only a scale can tell.
    """
    wanted = si_unit(column, axis)
    if unit.strip() in (wanted, wanted.replace(" ", "*")):
        return 1.0
    registry = _registry()
    try:
        parsed = registry.Unit(_SPELLINGS.get(unit.strip(), unit.strip()))
        if str(parsed) in _BARE_NUMBERS:
            raise BadParameter(
                f"the unit '{unit}' of column '{column}' has no fixed size: give what one step is worth instead, "
                f"for example --scale {column}=0.001 (in {wanted})."
            )
        return float(registry.Quantity(1.0, parsed).to(wanted.replace(" ", "*")).magnitude)
    except BadParameter:
        raise
    except Exception as error:  # pint raises a dozen different types on odd text
        hint = (
            f"; a current or voltage becomes a torque through --scale {column}=VALUE" if wanted in ("N m", "N") else ""
        )
        raise BadParameter(
            f"the unit '{unit}' of column '{column}' cannot be converted to {wanted}: use a unit of that kind{hint}."
        ) from error
