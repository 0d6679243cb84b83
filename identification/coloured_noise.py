"""Coloured measurement noise: filters in an encoder or a drive correlate the errors of neighbouring samples.

Without it, an observer takes slow noise for motion and follows it. The noise counts as coloured where a short
autoregression of its own explains the log clearly better than an observer does. From then on the log carries a colour,
and every fit of it finds its own (generalised least squares; Cochrane and Orcutt 1949).

A good model shows it in a free simulation, a poor one behind an observer that keeps it near the log and is yet too slow
to follow the noise. Noise that outlasts the observer's corrections cannot be told from motion and is left to it, and so
is a colour behind an observer that hardly helps: a poor model can leave as much.

Beside a right model and the right colour nothing predicts the readings better. So where a mere regression on the
readings and torques before does, which knows nothing of the machine, the colour is that of the model's errors.
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
_WORTH = 0.05  # the same for each sample behind an observer: the innovations get smaller by a twentieth
_SLOWER = 3.0  # from one observer to the next
_SLOWEST = 0.01  # of the best observer's bandwidth: slower ones leave the model to itself


def with_coloured_noise(fit: Fit, *, of_the_sensor: bool = False) -> Fit:
    """The same model fitted to the log with the colour of its reading's noise, or the fit as it is.

    A colour beside which nothing of the model is told stands for the motion, not for noise.

    Args:
        fit: of the model with white noise.
        of_the_sensor: whether only the sensor's noise counts. Who identifies a model takes its errors for noise as
            well, and has better parameters for it; who asks what it lacks must not.
    """
    usable = (coloured for coloured in _coloured(fit) if coloured.failed is None)
    found = max(usable, key=lambda coloured: coloured.log_likelihood, default=fit)
    likely = found.log_likelihood > fit.log_likelihood + _CLEARLY
    if not likely or (of_the_sensor and found.log_likelihood < by_regression(fit.log)):
        return fit
    return found


def by_regression(log: Log) -> float:
    """Log-likelihood of the readings by a regression on those before and the torques, less half a log for each slope.

    (Ljung 1999, section 4.2: ARX; Schwarz 1978.)
    """
    told, before = [], []
    for run in log.runs:
        if len(run) > ORDER:
            windows = [sliding_window_view(values, ORDER + 1) for values in (run.measured, run.command)]
            seen = sliding_window_view(run.valid, ORDER + 1).all(axis=1)
            told.append(windows[0][seen, -1])
            before.append(np.hstack([window[seen, :-1] for window in windows]))
    if not told:
        return -np.inf
    readings, columns = np.concatenate(told), np.vstack(before)
    columns = np.column_stack((columns, np.ones(readings.size)))
    columns /= np.maximum(np.linalg.norm(columns, axis=0), 1e-300)  # whatever their units
    slopes = np.linalg.lstsq(columns, readings, rcond=None)[0]
    samples = sum(int(run.valid.sum()) for run in log.runs)
    cost = float(np.sum((readings - columns @ slopes) ** 2)) * samples / max(readings.size, 1)
    return log_likelihood(cost, samples) - 0.5 * slopes.size * float(np.log(samples))


def _coloured(fit: Fit) -> Iterator[Fit]:
    """The fit with a colour of the reading, behind slower and slower observers and in a free simulation."""
    problem = Problem.of(fit.log, fit.model, known=fit.known)
    free = problem.solve(free=True) if fit.bandwidth else fit
    if not free.bandwidth and autoregression(free.innovations).size:
        coloured = problem.recoloured(free, fit.log_likelihood)
        if coloured is not None:
            yield coloured
    bandwidth, least = fit.bandwidth / _SLOWER, fit.log_likelihood + _WORTH * fit.samples
    while fit.bandwidth * _SLOWEST < bandwidth:
        coloured = problem.recoloured(replace(fit, bandwidth=bandwidth), least)
        if coloured is not None and fit.log.sample_time < coloured.noise_memory < 1.0 / bandwidth:
            yield coloured
        bandwidth /= _SLOWER
