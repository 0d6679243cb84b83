"""Signed values that a drive's register or a logger has stored without their sign.

Small servos send a magnitude with the sign in one bit (Feetech: the load in bit 10, the speed in bit 15), and a signed
number of 16 or 32 bits that is read as unsigned has its negative values at the upper end. Either way the values form
two groups of whole numbers, far apart.
"""

from __future__ import annotations

import numpy as np

from identification.recording import Array

_LEVELS = 5  # least number of different values on each side: a staircase has gaps, too
_WORDS = (16, 32)  # bits of a signed number


def signed(values: Array) -> tuple[Array, str]:
    """Values (T,) with their sign, and a sentence on how it was stored; unchanged and "" if there is no sign bit."""
    known = values[np.isfinite(values)]
    if not known.size or known.min() < 0 or not known.max() >= 2.0 or np.any(known != np.round(known)):
        return values, ""
    bit = int(np.log2(known.max()))
    half = 2.0**bit
    below, above = np.unique(known[known < half]), np.unique(known[known >= half])
    if min(len(below), len(above)) < _LEVELS or below[-1] >= 0.5 * half:
        return values, ""
    if above[-1] < 1.5 * half:
        return np.where(values >= half, half - values, values), f"has its sign in bit {bit}"
    if above[0] >= 1.5 * half and bit + 1 in _WORDS:
        return np.where(values >= half, values - 2.0 * half, values), f"is a signed number of {bit + 1} bits"
    return values, ""
