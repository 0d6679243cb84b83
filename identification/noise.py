"""Coloured innovations, and their effect on the uncertainty of an estimate.

A perfect predictor leaves white innovations. Real innovations are coloured (quantisation, filters in the drive,
friction that is not quite repeatable). If this is ignored, the same information is counted several times. An
autoregression of the innovations (Box and Jenkins 1970) corrects for it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import solve_toeplitz

from plant.effects.effect import Array

ORDER = 20


def autoregression(innovations: Array, order: int = ORDER) -> Array:
    """(p,) coefficients that predict an innovation from its past, for innovations (T,); p <= order.

    The Yule-Walker estimate is always stable. Schwarz's criterion selects p; for white innovations it is zero.
    """
    n = innovations.size
    order = min(order, n // 10)
    largest = float(np.max(np.abs(innovations), initial=0.0))
    if order < 1 or not 0.0 < largest < np.inf:
        return np.zeros(0)
    centred = innovations / largest
    centred = centred / np.sqrt(np.mean(centred**2))
    lags = np.array([centred[lag:] @ centred[: n - lag] for lag in range(order + 1)]) / n
    lags[0] *= 1.0 + 1e-9
    best, least = np.zeros(0), 0.0
    for p in range(1, order + 1):
        coefficients = np.asarray(solve_toeplitz(lags[:p], lags[1 : p + 1]), dtype=float)
        left = max(1.0 - float(coefficients @ lags[1 : p + 1]) / lags[0], 1e-300)
        cost = n * float(np.log(left)) + p * float(np.log(n))
        if cost < least:
            best, least = coefficients, cost
    return best


def whiten(values: Array, coefficients: Array) -> Array:
    """(T, ...) part of the values that the autoregression does not predict, along the first axis."""
    from scipy.signal import lfilter  # takes half a second to import

    return np.asarray(lfilter(np.concatenate(([1.0], -coefficients)), [1.0], values, axis=0), dtype=float)


def short_autoregression(innovations: Array) -> tuple[float, float]:
    """Yule-Walker coefficients of order two; zero for innovations that are all zero or overflowed."""
    n, largest = innovations.size, float(np.max(np.abs(innovations), initial=0.0))
    if not 0.0 < largest < np.inf:
        return 0.0, 0.0
    scaled = innovations / largest
    lags = np.array([scaled[lag:] @ scaled[: n - lag] for lag in range(3)]) / n
    first, second = solve_toeplitz(lags[:2] + np.array([1e-12 * lags[0], 0.0]), lags[1:])
    return float(first), float(second)


class Whitening:
    """`whiten`, piece by piece."""

    def __init__(self, coefficients: Sequence[float]) -> None:
        """All values before the first piece are zero."""
        self._filter = np.concatenate(([1.0], -np.asarray(coefficients, dtype=float)))
        self._state: Array | None = None

    def __call__(self, values: Array) -> Array:
        """(T, M) whitened values of the next piece (T, M)."""
        if self._filter.size == 1:
            return values
        from scipy.signal import lfilter

        before = np.zeros((self._filter.size - 1, values.shape[1])) if self._state is None else self._state
        found, self._state = lfilter(self._filter, [1.0], values, axis=0, zi=before)
        return np.asarray(found, dtype=float)


def colour(values: Array, coefficients: Array) -> Array:
    """(T, ...) the inverse of `whiten`."""
    from scipy.signal import lfilter

    return np.asarray(lfilter([1.0], np.concatenate(([1.0], -coefficients)), values, axis=0), dtype=float)


def colouring(residuals: Array) -> tuple[Array, float]:
    """Autoregression (p,) of residuals (T,) and the variance of its white input."""
    coefficients = autoregression(residuals)
    with np.errstate(over="ignore", invalid="ignore"):
        return coefficients, float(np.mean(whiten(residuals, coefficients) ** 2))


def log_likelihood(cost: float, samples: int) -> float:
    """Gaussian log-likelihood of a sum of squared innovations, with the noise variance that maximises it."""
    return float(-0.5 * samples * (np.log(2.0 * np.pi * max(cost, 1e-300) / samples) + 1.0))
