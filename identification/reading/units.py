"""Conversion of log columns to SI; it is done only when a log is read."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache

import numpy as np

from plant.errors import BadParameter
from plant.units import LONGEST, quantity

# SI unit of each column of the log contract.
SI_UNITS = {
    "time": "s",
    "torque": "N m",
    "torque_1": "N m",
    "torque_2": "N m",
    "force": "N",
    "current": "A",
    "current_1": "A",
    "current_2": "A",
    "voltage": "V",
    "duty": "1",
    "angle": "rad",
    "angle_1": "rad",
    "angle_2": "rad",
    "position": "m",
    "payload_mass": "kg",
    "payload_radius": "m",
    "payload_inertia": "kg m^2",
    "payload_gravity": "N m",
}

# Columns with a unit that depends on the axis: rotary, linear.
AXIS_UNITS = {
    "velocity": ("rad/s", "m/s"),
    "reference": ("rad", "m"),
    "setpoint": ("rad", "m"),
    "kp": ("N m/rad", "N/m"),
    "kd": ("N m s/rad", "N s/m"),
}

# One column of each possible unit, with its axis; nm is tried as a length before a torque.
_KINDS = (
    ("position", "linear"),
    *((column, "rotary") for column in ("time", "torque", "angle", "velocity", "current", "voltage")),
    *((column, "linear") for column in ("force", "velocity")),
)

_MEANT = {"grad": "deg", "rev": "turn", "revs": "turn", "umdr": "turn", "upm": "rpm", "rps": "turn/s", "dps": "deg/s"}
_MEANT |= {"amp": "A", "amps": "A"}
"""Units that pint does not know, or takes for another unit: the German Grad is not gon, amps no attometres a second."""
_WEIGHT, _ARM = r"(?P<weight>kg|g|oz|lb)f?s?", r"(?P<arm>m|cm|mm|in|ft)"
_WEIGHT_ON_ARM = re.compile(rf"{_WEIGHT}{_ARM}|{_ARM.replace('arm', 'other')}{_WEIGHT.replace('weight', 'heavy')}")

_PER_MINUTE = re.compile(r"(?<![A-Za-z0-9])((1|U|r|rev|tr|giri|Umdr\.?)/min|min(\^|\*\*)?-1|min⁻¹)(?![A-Za-z0-9])")

# pint treats these as numbers, and so as radians; only the user knows their size.
_BARE_NUMBERS = {"count", "percent", "permille", "ppm", "dimensionless", "bit", "byte"}
_ELECTRICAL = "erpm"  # turns of the field per minute: the speed of the shaft times the pole pairs
_SHARES = {"percent", "permille", "ppm", "dimensionless"}  # known shares of one

_SUCH_AS = {"rad": "deg", "rad/s": "deg/s", "m": "mm", "m/s": "mm/s", "s": "ms", "N m": "mNm", "N": "kN", "A": "mA"}

_EXAMPLE_SIZE = {
    "rad": "turn/131072",
    "rad/s": "turn/131072/s",
    "N m": "2.4Nm/1000",
    "1": "1/255",
}  # example for one step of the drive's value


def is_unit(text: str) -> bool:
    """Whether a text is any unit, also one that no log column has: "N m", "1/min", "V"."""
    if re.search(r"\d{3}|[<>=!]", text):
        return False
    spellings = (_PER_MINUTE.sub("rpm", spelling) for spelling in _spellings(text, "N*m"))
    return any(_is_known(spelling) and not quantity(spelling).unitless for spelling in spellings)


def _spellings(unit: str, wanted: str) -> Iterator[str]:
    """Possible spellings of a unit if the SI unit `wanted` is needed, best first: `RPM`, `Grad`, `oz-in`, `kg.cm`."""
    unit = re.sub(r"[A-Za-z]+", lambda word: _MEANT.get(word[0].lower(), word[0]), unit)
    low = unit.lower()
    yield unit
    if wanted == "N*m":
        found = _WEIGHT_ON_ARM.fullmatch(re.sub(r"[-.*·⋅ ]", "", low))
        if found:
            yield f"{found['weight'] or found['heavy']}f*{found['arm'] or found['other']}"
        if low == "nm":
            yield "N*m"
    if low != unit and "nm" not in low and not _is_known(unit):  # A is not a year, NM not nanometres
        yield low


def _is_known(unit: str) -> bool:
    """Whether pint knows a unit in this spelling."""
    try:
        quantity(unit)
    except Exception:  # pint raises a dozen different types on odd text
        return False
    return True


def si_unit(column: str, axis: str) -> str:
    """The SI unit of a contract column on a "rotary" or "linear" axis."""
    if column in AXIS_UNITS:
        return AXIS_UNITS[column][axis == "linear"]
    return SI_UNITS[column]


@cache
def kind_of(unit: str) -> str | None:
    """The SI unit to which a unit can be converted ("s", "N m", "rad", ...), None if it is not a unit of a log."""
    for column, axis in _KINDS:
        try:
            si_factor(column, unit, axis)
        except BadParameter:
            continue
        return si_unit(column, axis)
    return None


def si_factor(column: str, unit: str, axis: str) -> float:
    """Factor from `unit` to the SI unit of `column`.

    A unit may have a factor: an encoder's count is `turn/131072`, a drive's per mille of 2.4 N m is `2.4 N m/1000`.

    Raises `BadParameter` if the unit is unknown, is of another kind, or is a bare number (counts, per mille), for
    which the user must give the size.
    """
    wanted = si_unit(column, axis)
    if unit.strip() in (wanted, wanted.replace(" ", "*")):
        return 1.0
    if unit.strip().lower() == _ELECTRICAL:
        raise BadParameter(
            f"the unit '{unit}' of column '{column}' counts turns of the field: divide by the motor's pole pairs, "
            f"for example of 7 with --unit {column}=rpm/7."
        )
    try:
        factor, sized = _factor(unit.strip(), wanted.replace(" ", "*"))
    except Exception as error:  # pint raises a dozen different types on odd text
        hint = _hint(column, wanted, unit)
        raise BadParameter(
            f"the unit '{unit[:LONGEST]}' of column '{column}' cannot be converted to {wanted}: "
            f"use a unit of that kind, such as {_SUCH_AS.get(wanted, wanted)}{hint}."
        ) from error
    if not sized:
        example = _EXAMPLE_SIZE.get(wanted)
        if example and unit.strip() in ("%", "percent"):
            example = re.sub(r"/\d+", "/100", example)
        raise BadParameter(
            f"the unit '{unit}' of column '{column}' has no fixed size: give the size of one step instead, for "
            f"example {f'--unit {column}={example} or ' if example else ''}--scale {column}=0.001 (in {wanted})."
        )
    return factor


def _hint(column: str, wanted: str, unit: str) -> str:
    """A hint on what the user may have meant."""
    if wanted in ("N m", "N"):
        return (
            f"; a current or voltage becomes a torque through --scale {column}=VALUE, or is given as it is with "
            "--map current=NAME, --map voltage=NAME"
        )
    if column == "setpoint":
        return (
            "; a set-point of the speed does not determine the torque, which the drive computes from it: log the "
            "torque or the motor's current beside it"
        )
    return f", or give the size of one {unit} with --scale {column}=0.5" if is_unit(unit) else ""


def _factor(unit: str, wanted: str) -> tuple[float, bool]:
    """Factor to the wanted SI unit, and whether the unit has a known size; may raise any exception."""
    *others, last = _spellings(unit, wanted)
    for spelling in others:
        try:
            return _factor_of(spelling, wanted)
        except Exception:  # pint raises a dozen different types on odd text
            continue
    return _factor_of(last, wanted)


def _factor_of(unit: str, wanted: str) -> tuple[float, bool]:
    """`_factor` of one spelling."""
    unit = re.sub(r"\brotations?\b", "turn", _PER_MINUTE.sub("rpm", unit))
    found = quantity(unit.replace("%", "percent") if wanted == "1" else unit)
    names = {str(name) for name in found.units._units}
    if names <= _BARE_NUMBERS and not (wanted == "1" and names <= _SHARES):
        return 1.0, False
    factor = float(found.to("" if wanted == "1" else wanted).magnitude)
    if not (np.isfinite(factor) and factor > 0):
        raise ValueError(unit)
    turns = "radian" in str(found.to_root_units().units)  # pint takes hertz and counts/s for rad/s
    return factor, turns or "rad" not in wanted
