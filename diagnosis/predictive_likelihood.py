"""The end of a log, foretold from a fit to what comes before: what a model promises has to come true there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from diagnosis.holdout import bounded
from identification.fit_result import Fit
from identification.least_squares import Minimum, NormalEquations
from identification.predictor import Prediction
from identification.problem import Problem
from identification.sums_over_runs import normal_equations
from plant.effects.effect import Array

LAST = 0.25
"""Share of each run at its end."""
_ROUNDING = 1e-12  # of the largest, below which a direction of the parameters is rounding


def predictive_loss(before: Fit, after: Fit) -> float:
    """By how much an extended model is less likely in the last part, each with the observer that it asks for."""
    return _predictive_log_likelihood(before) - _predictive_log_likelihood(after)


def _predictive_log_likelihood(fit: Fit) -> float:
    """Log-likelihood of the last part of the runs given the first part."""
    problem, best, predictions = _continued(fit, fit.bandwidth, slopes=True)
    rest = [
        (place, replace(p, innovations=p.innovations[len(run) :], jacobian=p.jacobian[len(run) :]))
        for place, (run, p) in enumerate(zip(problem.log.runs, predictions, strict=True))
    ]
    samples = int(_masks(fit, problem).sum())
    coming = normal_equations(rest, len(rest))
    return predictive_log_density(
        best.equations.information, coming, best.equations.cost / problem.samples, problem.samples, samples
    )


def predictive_log_density(seen: Array, coming: NormalEquations, variance: float, before: int, after: int) -> float:
    """Log-likelihood of samples to come, with what those before them leave open of the parameters (Dawid 1984).

    With the information I = J'J of those before and the normal equations K = J'J, g = J'e of those to come,

        -(e'e - g'(I + K)^-1 g) / (2 s^2) - log det(1 + I^-1 K) / 2 - n log s.

    A direction of which the samples before say nothing pays as a parameter does in a fit to all.

    Args:
        seen: (n, n) I.
        coming: normal equations of the samples to come, about the fit to those before.
        variance: s^2 of a sample.
        before, after: how many samples.
    """
    if not np.isfinite(coming.cost):
        return -np.inf
    both = seen + coming.information
    scale = np.sqrt(np.maximum(np.diag(both), 1e-300))
    shares, directions = np.linalg.eigh(both / np.outer(scale, scale))
    known = shares > _ROUNDING * shares.max()
    half = directions[:, known] / np.sqrt(shares[known]) / scale[:, None]
    news = np.linalg.eigvalsh(half.T @ coming.information @ half)  # of what both tell
    explained = float(((half.T @ coming.gradient) ** 2).sum())
    left = np.maximum(1.0 - news, 1.0 / before)
    return -0.5 * float((coming.cost - explained) / variance - np.log(left).sum() + after * np.log(variance))


def log_likelihood_by_sample(fit: Fit, bandwidth: float) -> Array:
    """(U,) log-likelihood of each sample that counts in the last part of the runs, after a fit to the first part."""
    problem, best, predictions = _continued(fit, bandwidth, slopes=False)
    variance = best.equations.cost / problem.samples
    pairs = zip(problem.log.runs, predictions, strict=True)
    coming = bounded(np.concatenate([prediction.innovations[len(part) :] for part, prediction in pairs]))
    counts = coming[_masks(fit, problem)]
    return np.asarray(-0.5 * counts**2 / variance - 0.5 * np.log(variance))


def _masks(fit: Fit, problem: Problem) -> NDArray[np.bool_]:
    """Which samples of the last part count: of one that is masked nothing is foretold."""
    pairs = zip(fit.log.runs, problem.log.runs, strict=True)
    return np.concatenate([run.valid[len(part) :] for run, part in pairs])


def _continued(fit: Fit, bandwidth: float, *, slopes: bool) -> tuple[Problem, Minimum, list[Prediction]]:
    """A fit to the first part of the runs, and by it predictions of the whole."""
    seen = replace(fit.log, runs=tuple(run.slice(0, int(len(run) * (1.0 - LAST))) for run in fit.log.runs))
    problem = Problem.of(seen, fit.model, known=fit.known)
    best = problem.minimise(problem.pack(fit.model.values, fit.initial), bandwidth, 0.0, iterations=5)
    values, initial = problem.unpack(best.point)
    whole = replace(problem.predictor, runs=fit.log.runs, free=problem.free if slopes else ())
    return problem, best, whole.predict(values, initial, bandwidth=bandwidth, width=0.0, sensitivities=slopes)
