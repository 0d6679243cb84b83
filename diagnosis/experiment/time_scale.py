"""How slow a servo is, as far as an experiment has to know it: what is sampled slowly moves slowly.

The numbers of the design stand for a log of 5 ms. Who samples more slowly has nothing to see that is as fast, and needs
as many samples. Who samples faster may have a servo that is no faster, so nothing is shortened.
"""

from __future__ import annotations

_SAMPLE_TIME = 5e-3  # for which the numbers stand [s]


def time_scale(sample_time: float) -> float:
    """Factor of times, and divisor of frequencies and bandwidths, at a sample time [s]; at least 1 [-]."""
    return max(sample_time / _SAMPLE_TIME, 1.0)
