"""Sums over the runs of a log: its runs share the parameters, and each has an initial state of its own.

A point of a fit is (F + 2R,): the parameters, then angle and velocity at the first sample of each run. Of the Jacobian
of a run only F + 2 columns are not zero; these sums are all that is needed of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from identification.least_squares import NormalEquations
from identification.noise import colour, colouring
from identification.predictor import Prediction
from plant.effects.effect import Array


def normal_equations(pieces: Iterable[tuple[int, Prediction]], runs: int) -> NormalEquations:
    """The normal equations of a log from pieces of its runs, each with the place of its run."""
    cost, gradient, information = 0.0, np.zeros(0), np.zeros((0, 0))
    for run, piece in pieces:
        if not gradient.size:
            size = piece.jacobian.shape[1] + 2 * (runs - 1)
            gradient, information = np.zeros(size), np.zeros((size, size))
        own, part = _places(piece, run), NormalEquations.of(piece.innovations, piece.jacobian)
        cost += part.cost
        with np.errstate(over="ignore", invalid="ignore"):
            gradient[own] += part.gradient
            information[np.ix_(own, own)] += part.information
    if not np.isfinite(cost):
        cost = np.inf
    return NormalEquations(cost=cost, gradient=gradient, information=information)


def informations(predictions: Sequence[Prediction]) -> tuple[Array, Array]:
    """(F + 2R, F + 2R) J'J and J'RJ, with R the covariance of the innovations, which ends where a run does."""
    coefficients, variance = colouring(np.concatenate([p.innovations for p in predictions]))
    size = predictions[0].jacobian.shape[1] + 2 * (len(predictions) - 1)
    white, coloured = np.zeros((size, size)), np.zeros((size, size))
    for run, p in enumerate(predictions):
        own = np.ix_(_places(p, run), _places(p, run))
        with np.errstate(over="ignore", invalid="ignore"):  # of a model that all but runs off nothing is known
            white[own] += p.jacobian.T @ p.jacobian
            backwards = colour(p.jacobian[::-1], coefficients)
            coloured[own] += variance * (backwards.T @ backwards)
    return white, coloured


def _places(prediction: Prediction, run: int) -> NDArray[np.intp]:
    """(F + 2,) places of a run's columns among those of the log."""
    free = prediction.jacobian.shape[1] - 2
    return np.append(np.arange(free), free + 2 * run + np.arange(2))
