"""Sums over the runs of a log: the runs share the parameters, and each has its initial state.

A point of a fit is (F + R I,): the parameters, then the initial state of each run: angle and velocity, and the hidden
states where these are fitted. If M of the parameters differ from run to run it is (F - M + R M + R I,): the shared
parameters, those of each run, then the initial states. The Jacobian of a run has only F + I non-zero columns; a fit
needs only these sums of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from identification.least_squares import NormalEquations
from identification.noise import colour, colouring
from identification.predictor import Prediction
from plant.effects.effect import Array


def normal_equations(pieces: Iterable[tuple[int, Prediction]], runs: int, own: Sequence[int] = ()) -> NormalEquations:
    """The normal equations of a log from pieces of its runs, each with the index of its run.

    Args:
        pieces: of all runs.
        runs: R, the number of runs.
        own: (M,) rows of the parameters that differ from run to run.
    """
    cost, gradient, information = 0.0, np.zeros(0), np.zeros((0, 0))
    for run, piece in pieces:
        if not gradient.size:
            size = point_size(piece.jacobian.shape[1] - piece.initials, runs, own, piece.initials)
            gradient, information = np.zeros(size), np.zeros((size, size))
        at = places(piece.jacobian.shape[1] - piece.initials, run, runs, own, piece.initials)
        part = NormalEquations.of(piece.innovations, piece.jacobian)
        cost += part.cost
        if not np.isfinite(cost):
            break
        with np.errstate(over="ignore", invalid="ignore"):
            gradient[at] += part.gradient
            information[np.ix_(at, at)] += part.information
    if not np.isfinite(cost):
        cost = np.inf
    return NormalEquations(cost=cost, gradient=gradient, information=information)


def informations(predictions: Sequence[Prediction], own: Sequence[int] = ()) -> tuple[Array, Array]:
    """J'J and J'RJ, with R the covariance of the innovations, zero between runs; `own` as in `normal_equations`."""
    coefficients, variance = colouring(np.concatenate([p.innovations for p in predictions]))
    initials, runs = predictions[0].initials, len(predictions)
    free = predictions[0].jacobian.shape[1] - initials
    size = point_size(free, runs, own, initials)
    white, coloured = np.zeros((size, size)), np.zeros((size, size))
    for run, p in enumerate(predictions):
        at = places(free, run, runs, own, initials)
        block = np.ix_(at, at)
        with np.errstate(over="ignore", invalid="ignore"):  # of a nearly unstable model
            white[block] += p.jacobian.T @ p.jacobian
            backwards = colour(p.jacobian[::-1], coefficients)
            coloured[block] += variance * (backwards.T @ backwards)
    return white, coloured


def point_size(free: int, runs: int, own: Sequence[int], initials: int = 2) -> int:
    """Length of a point with `free` parameters, of which those in `own` differ from run to run."""
    return free + len(own) * (runs - 1) + initials * runs


def places(free: int, run: int, runs: int, own: Sequence[int] = (), initials: int = 2) -> NDArray[np.intp]:
    """(F + I,) indices of a run's columns among those of the log."""
    found, shared = np.empty(free + initials, dtype=np.intp), free - len(own)
    found[[row for row in range(free) if row not in own]] = np.arange(shared)
    found[list(own)] = shared + len(own) * run + np.arange(len(own))
    found[free:] = shared + len(own) * runs + initials * run + np.arange(initials)
    return found
