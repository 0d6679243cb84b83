"""A number with its standard error, as it is printed."""

from __future__ import annotations

import numpy as np

from plant.units import printed

_PREFIXED = ("rad", "m")
_PREFIXES = {-9: "n", -6: "µ"}
_ROUNDING = 1e-9  # relative: a smaller standard error is one of rounding


def measured(value: float, std: float | None, unit: str = "") -> str:
    """A number with its standard error and unit, rounded to the digits of the standard error: 79.3 ± 6.8 µrad.

    The standard error has one digit, or two if the first is a 1 or a 2. Very small or large numbers have a unit with a
    prefix, or a common power of ten. Without a standard error the number has three digits.
    """
    unit = printed(unit)
    if std is None or not (_ROUNDING * abs(value) < std < np.inf):
        return f"{value:.3g} {unit}".rstrip()
    most = int(np.floor(np.log10(max(abs(value), std))))
    tens = most if most < -3 or most > 5 else 0
    prefix = _PREFIXES.get(3 * (most // 3), "") if unit in _PREFIXED and tens else ""
    tens = 3 * (most // 3) if prefix else tens
    value, std = value / 10.0**tens, std / 10.0**tens
    last = int(np.floor(np.log10(std)))
    last -= f"{std:e}"[0] in "12"
    text = f"{round(value, -last):.{max(-last, 0)}f} ± {round(std, -last):.{max(-last, 0)}f}"
    if tens and not prefix:
        text = f"({text})e{tens:+03d}"
    return f"{text} {prefix}{unit}".rstrip()
