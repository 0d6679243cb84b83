"""Numbers of Python, and scalars of NumPy and other libraries, as parameters; and their largest magnitude."""

from __future__ import annotations

import math
import operator
from numbers import Real
from typing import Any

from plant.errors import BadParameter

HUGE = 1e12
"""Largest magnitude of a servo's quantity in SI units: squares of larger ones would lose their digits."""


def finite(value: Any) -> float | None:
    """The value as a float, None unless it is a finite real number; a boolean is none."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def whole(value: Any) -> int | None:
    """The value as an int, None unless its type is a whole number; a boolean is none."""
    if isinstance(value, bool):
        return None
    try:
        return operator.index(value)
    except TypeError:
        return None


def refuse_huge(name: str, value: float) -> None:
    """Raise `BadParameter` for a magnitude that no servo has."""
    if abs(value) > HUGE:
        raise BadParameter(f"{name} = {value:g} is beyond what a servo can have, {HUGE:g} in SI units; check its unit.")
