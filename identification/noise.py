"""The colour of what a predictor leaves: autoregressive whitening of innovations.

A perfect predictor leaves white innovations. Real measurement noise has a colour (quantisation, filters in the drive,
friction that is not quite repeatable), and a likelihood that ignores it counts the same evidence several times over. So
the innovations are modelled as an autoregression (Box and Jenkins 1970), whose coefficients are nuisance parameters of
every model alike.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

from plant.effects.effect import Array

ORDER = 8


def autoregression(innovations: Array, order: int = ORDER) -> Array:
    """(order,) coefficients that predict an innovation (T,) from its past (Yule-Walker; always a stable model)."""
    n = innovations.size
    order = min(order, n // 10)
    if order < 1 or not np.any(innovations):
        return np.zeros(0)
    centred = innovations / np.sqrt(np.mean(innovations**2))
    lags = np.array([centred[lag:] @ centred[: n - lag] for lag in range(order + 1)]) / n
    lags[0] *= 1.0 + 1e-9
    return np.asarray(solve_toeplitz(lags[:-1], lags[1:]), dtype=float)


def whiten(values: Array, coefficients: Array) -> Array:
    """(T, ...) what the autoregression does not predict of the values, along the first axis."""
    return np.asarray(lfilter(np.concatenate(([1.0], -coefficients)), [1.0], values, axis=0), dtype=float)


def colour(values: Array, coefficients: Array) -> Array:
    """(T, ...) the inverse of `whiten`."""
    return np.asarray(lfilter([1.0], np.concatenate(([1.0], -coefficients)), values, axis=0), dtype=float)


def log_likelihood(innovations: Array, samples: int) -> float:
    """Gaussian log-likelihood of innovations (T,) of which `samples` count, colour and level at their best values."""
    with np.errstate(over="ignore", invalid="ignore"):
        white = whiten(innovations, autoregression(innovations))
        variance = float(white @ white) / samples
    if not np.isfinite(variance):
        return -np.inf
    return float(-0.5 * samples * (np.log(2.0 * np.pi * max(variance, 1e-300)) + 1.0))
