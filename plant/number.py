"""What counts as a number: Python's own, and scalars of NumPy and other libraries alike; and how large it may be."""

from __future__ import annotations

import math
import operator
from numbers import Real
from typing import Any

from plant.errors import BadParameter

HUGE = 1e12
"""No quantity of a servo is beyond it in SI units: squares would lose their digits."""


def finite(value: Any) -> float | None:
    """The value as a float, None unless it is a finite real number; a truth value is none."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def whole(value: Any) -> int | None:
    """The value as an int, None unless it is a whole number by its type; a truth value is none."""
    if isinstance(value, bool):
        return None
    try:
        return operator.index(value)
    except TypeError:
        return None


def refuse_huge(name: str, value: float) -> None:
    """Raise `BadParameter` for a number that no servo has, in either sense."""
    if abs(value) > HUGE:
        raise BadParameter(f"{name} = {value:g} is beyond what a servo can have, {HUGE:g} in SI units; check its unit.")
