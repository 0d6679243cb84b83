"""How slow a servo is, as far as a rate has to be chosen before it is known: what is sampled slowly moves slowly.

Rates and times stand for a log of 5 ms. Who samples more slowly has nothing to see that is as fast, and needs as many
samples. Who samples faster may have a servo that is no faster, so nothing is shortened.
"""

from __future__ import annotations

SAMPLE_TIME = 5e-3
"""For which rates and times stand [s]."""


def pace(sample_time: float) -> float:
    """Factor of times, and divisor of rates, at a sample time [s]; at least 1 [-]."""
    return max(sample_time / SAMPLE_TIME, 1.0)
