"""Time scale of an experiment, from the sample time of the log.

The constants of the design hold for a sample time of 5 ms. With slower sampling fast motion is not visible, and the
same number of samples is needed, so times are scaled up. With faster sampling the servo may be no faster, so times are
not scaled down.
"""

from __future__ import annotations

_SAMPLE_TIME = 5e-3  # for which the constants hold [s]


def time_scale(sample_time: float) -> float:
    """Factor of times, and divisor of frequencies and bandwidths, at a sample time [s]; at least 1 [-]."""
    return max(sample_time / _SAMPLE_TIME, 1.0)
