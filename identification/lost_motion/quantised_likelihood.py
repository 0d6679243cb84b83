"""Likelihood of measurements that an encoder rounded, with derivatives by the expected angle and by the noise.

An encoder shows the angle plus noise, rounded to the nearest count. A measurement y with counts c has the likelihood

    P(y) = Phi(u) - Phi(v),   u = (y + c/2 - m) / sigma,   v = (y - c/2 - m) / sigma

for an expected angle m and noise of standard deviation sigma (grouped observations, Sheppard 1898, Stewart 1983). If
the noise is below a count, this uses far more information than a model with additive noise of c/sqrt(12): where the
count changes, the angle is known; and where the measurement alternates between counts, their frequencies give the
angle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class QuantisedLikelihood:
    """Log-likelihood of each of N measurements with its derivatives by (m, log sigma).

    Attributes:
        value: (N,).
        slope: (N, 2) first derivatives.
        curvature: (N, 2, 2) second derivatives.
    """

    value: Array
    slope: Array
    curvature: Array


def quantised_likelihood(measured: Array, expected: Array, *, count: float, noise: float) -> QuantisedLikelihood:
    """Log-likelihood of measurements (N,) rounded to a count, for expected angles (N,) plus noise; all in [rad]."""
    upper = (measured + 0.5 * count - expected) / noise
    lower = (measured - 0.5 * count - expected) / noise
    mirrored = lower > 0.0  # differences of Phi keep their digits in the lower tail only
    large = log_ndtr(np.where(mirrored, -lower, upper))
    small = log_ndtr(np.where(mirrored, -upper, lower))
    value = large + np.log(-np.expm1(small - large))
    u, v = (np.exp(-0.5 * edge**2 - 0.5 * np.log(2.0 * np.pi) - value) for edge in (upper, lower))  # phi / P
    by_m, by_s = -(u - v) / noise, -(upper * u - lower * v)
    by_mm = by_s / noise**2
    by_ms = -(upper**2 * u - lower**2 * v - u + v) / noise
    by_ss = -by_s - (upper**3 * u - lower**3 * v)
    curvature = np.array([[by_mm - by_m**2, by_ms - by_m * by_s], [by_ms - by_m * by_s, by_ss - by_s**2]])
    return QuantisedLikelihood(value=value, slope=np.column_stack((by_m, by_s)), curvature=np.moveaxis(curvature, 2, 0))
