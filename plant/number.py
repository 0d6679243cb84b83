"""What counts as a number: Python's own, and the scalars of NumPy and of other libraries alike."""

from __future__ import annotations

import math
import operator
from numbers import Real
from typing import Any


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
