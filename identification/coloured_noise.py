"""Coloured measurement noise: filters in an encoder or a drive correlate the errors of neighbouring samples.

If this is ignored, an observer takes slow noise for motion and follows it. The noise counts as coloured if a short
autoregression explains the log clearly better than an observer does. `Log.colour` then holds its coefficients, and
every later fit of the log estimates them again (generalised least squares; Cochrane and Orcutt 1949).

With a good model the colour is visible in a free simulation. With a poor model it is visible with an observer that
keeps the model near the log but is too slow to follow the noise. Noise that is slower than the observer's corrections
cannot be distinguished from motion and is left to the observer. So is a colour with an observer that hardly raises the
likelihood: a poor model can leave as much.

With the right model and the right colour nothing predicts the measurement better. So if a plain regression on past
measurements and torques, without a model of the machine, predicts it better, the colour is one of the model errors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from identification.fit_result import Fit
from identification.log import Log
from identification.noise import ORDER, autoregression, log_likelihood
from identification.problem import Problem

_CLEARLY = 10.0  # rise of the log-likelihood from which coloured noise is accepted
_LEAST_GAIN = 0.05  # the same per sample with an observer: the innovations get smaller by a twentieth
_SLOWER = 3.0  # ratio of the bandwidths of successive observers
_SLOWEST = 0.01  # of the best observer bandwidth: a slower observer is nearly a free simulation


def with_coloured_noise(fit: Fit, *, of_the_sensor: bool = False) -> Fit:
    """The same model fitted to the log with coloured measurement noise, or the unchanged fit.

    A colour with which no parameter of the model is identifiable describes the motion, not the noise, and is rejected.

    Args:
        fit: of the model with white noise.
        of_the_sensor: accept only the colour of sensor noise. To identify a model, its errors may count as noise too,
            which improves the parameters. A diagnosis of missing effects must not count them as noise.
    """
    usable = (coloured for coloured in _coloured(fit) if coloured.failed is None)
    found = max(usable, key=lambda coloured: coloured.log_likelihood, default=fit)
    better = found.log_likelihood > fit.log_likelihood + _CLEARLY
    if not better or (of_the_sensor and found.log_likelihood < by_regression(fit.log)):
        return fit
    return found


def by_regression(log: Log) -> float:
    """Log-likelihood of the measurement by a regression on its past and past torques, less log(samples) / 2 per slope.

    (Ljung 1999, section 4.2: ARX; Schwarz 1978.)
    """
    targets, before = [], []
    for run in log.runs:
        if len(run) > ORDER:
            windows = [sliding_window_view(values, ORDER + 1) for values in (run.measured, run.command)]
            seen = sliding_window_view(run.valid, ORDER + 1).all(axis=1)
            targets.append(windows[0][seen, -1])
            before.append(np.hstack([window[seen, :-1] for window in windows]))
    if not targets:
        return -np.inf
    measurements, columns = np.concatenate(targets), np.vstack(before)
    columns = np.column_stack((columns, np.ones(measurements.size)))
    columns /= np.maximum(np.linalg.norm(columns, axis=0), 1e-300)  # whatever their units
    slopes = np.linalg.lstsq(columns, measurements, rcond=None)[0]
    samples = sum(int(run.valid.sum()) for run in log.runs)
    cost = float(np.sum((measurements - columns @ slopes) ** 2)) * samples / max(measurements.size, 1)
    return log_likelihood(cost, samples) - 0.5 * slopes.size * float(np.log(samples))


def _coloured(fit: Fit) -> Iterator[Fit]:
    """The fit with coloured measurement noise, in a free simulation and with slower and slower observers."""
    problem = Problem.of(fit.log, fit.model, known=fit.known)
    free = problem.solve(free=True) if fit.bandwidth else fit
    if not free.bandwidth and autoregression(free.innovations).size:
        coloured = problem.recoloured(free, fit.log_likelihood)
        if coloured is not None:
            yield coloured
    bandwidth, least = fit.bandwidth / _SLOWER, fit.log_likelihood + _LEAST_GAIN * fit.samples
    while fit.bandwidth * _SLOWEST < bandwidth:
        coloured = problem.recoloured(replace(fit, bandwidth=bandwidth), least)
        if coloured is not None and fit.log.sample_time < coloured.noise_memory < 1.0 / bandwidth:
            yield coloured
        bandwidth /= _SLOWER
