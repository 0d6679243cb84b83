"""Damped Gauss-Newton with bounds on the normal equations (Levenberg 1944, Marquardt 1963).

Logs are long and parameters few, so nearly all the work is one pass over the log for each trial. The remaining system
has the size of the parameter vector; it is solved here with an active set for the bounds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np
from numpy.typing import NDArray

from plant.effects.effect import Array

_RANK_TOLERANCE = 1e-12  # relative singular value below which regressors are collinear
_ROUNDING = 1e-8  # component of a unit vector that counts as zero


@dataclass(frozen=True, kw_only=True, eq=False)
class NormalEquations:
    """A least-squares problem linearised at a point.

    Attributes:
        cost: sum of squares of the residuals.
        gradient: (n,) gradient of half the cost.
        information: (n, n) Jacobian transposed times Jacobian.
    """

    cost: float
    gradient: Array
    information: Array

    @classmethod
    def overflowed(cls) -> NormalEquations:
        """At a point with an infinite cost, or one that is too high."""
        return cls(cost=np.inf, gradient=np.zeros(0), information=np.zeros((0, 0)))

    @classmethod
    def of(cls, residuals: Array, jacobian: Array) -> NormalEquations:
        """From residuals (T,) and their Jacobian (T, n); a residual that overflowed makes the cost infinite."""
        with np.errstate(over="ignore", invalid="ignore"):
            cost = float(residuals @ residuals)
            gradient, information = jacobian.T @ residuals, jacobian.T @ jacobian
        if not (np.isfinite(cost) and np.isfinite(gradient).all() and np.isfinite(information).all()):
            cost = np.inf
        return cls(cost=cost, gradient=gradient, information=information)


@dataclass(frozen=True, kw_only=True, eq=False)
class Minimum:
    """The point at which the iteration ended, and the problem linearised there."""

    point: Array
    equations: NormalEquations
    converged: bool
    evaluations: int


def minimise(
    evaluate: Callable[[Array, float], NormalEquations],
    start: Array,
    lower: Array,
    upper: Array,
    *,
    samples: int,
    iterations: int = 30,
    tolerance: float = 0.01,
    at_start: NormalEquations | None = None,
) -> Minimum:
    """Minimise a sum of squares within bounds.

    Args:
        evaluate: linearises the problem at a point (n,); with a cost above a limit, that may be infinite.
        start: (n,) first point, clipped into the bounds.
        lower: (n,) lower bounds.
        upper: (n,) upper bounds.
        samples: number of residuals.
        iterations: most evaluations of the problem.
        tolerance: stop if the predicted gain in log-likelihood (samples/2 log cost) of a step is less than this.
        at_start: the problem at `start`, if it is known already.
    """
    point = np.clip(start, lower, upper)
    here = at_start if at_start is not None else evaluate(point, np.inf)
    evaluations, damping, converged = int(at_start is None), 1e-6, here.cost == 0.0
    while evaluations < iterations and np.isfinite(here.cost) and here.cost > 0.0:
        # A positive quantity (a time, a width, an inertia) changes by a factor of five at most, so that an undetermined
        # direction does not diverge.
        least = np.where(lower > 0.0, np.maximum(lower, point / 5.0), lower)
        most = np.where(lower > 0.0, np.minimum(upper, point * 5.0), upper)
        step = _bounded_step(
            here, point, least, most, damping, insensitive=_insensitive(here, lower, upper, samples, tolerance)
        )
        promise = -(2.0 * here.gradient @ step + step @ here.information @ step)
        if 0.5 * samples * promise / here.cost < tolerance:
            converged = True
            break
        target = np.clip(point + step, lower, upper)
        there = evaluate(target, here.cost)
        evaluations += 1
        with np.errstate(over="ignore"):
            kept = (here.cost - there.cost) / promise  # actual over predicted decrease
        if kept > 1e-4:
            point, here = target, there
            damping = max(damping * (0.1 if kept > 0.5 else 1.0 if kept > 0.1 else 5.0), 1e-12)
        else:
            damping = max(damping * 30.0, 1e-5)
            if damping > 1e10:
                break
    converged = converged or here.cost == 0.0
    return Minimum(point=point, equations=here, converged=converged, evaluations=evaluations)


def _insensitive(
    here: NormalEquations, lower: Array, upper: Array, samples: int, tolerance: float
) -> NDArray[np.bool_]:
    """(n,) coordinates that the log does not determine here: the cost is the same from bound to bound.

    An example is the time of an event while the load rests. Such a coordinate is not changed: rounding would send it to
    its bound, where it may matter very much, and every step would be rejected.
    """
    known = np.diag(here.information)
    with np.errstate(over="ignore", invalid="ignore"):
        across = 0.5 * samples / here.cost * known * (upper - lower) ** 2
    return np.asarray((known <= 1e-280) | (across < tolerance))


def _bounded_step(
    here: NormalEquations, point: Array, lower: Array, upper: Array, damping: float, *, insensitive: NDArray[np.bool_]
) -> Array:
    """The damped step within the bounds (active set): a coordinate that would leave is fixed at its bound.

    After the others are solved, a fixed coordinate with a gradient to the inside is freed again, as the coordinate that
    pushed it out may itself be fixed by now. Otherwise the iteration can end at a bound that is not active.
    """
    scale = np.sqrt(np.maximum(np.diag(here.information), 1e-300))
    information = here.information / np.outer(scale, scale)
    information[np.diag_indices_from(information)] += damping
    gradient, least, most = here.gradient / scale, (lower - point) * scale, (upper - point) * scale
    step = np.zeros_like(point)  # in units in which every parameter carries the same information
    moving = ~(insensitive | ((least >= 0.0) & (gradient > 0.0)) | ((most <= 0.0) & (gradient < 0.0)))
    for _ in range(10 * point.size):
        if moving.any():
            pull = -(gradient + information @ np.where(moving, 0.0, step))
            step[moving] = np.linalg.lstsq(information[np.ix_(moving, moving)], pull[moving], rcond=1e-13)[0]
            outside = moving & ((step < least) | (step > most))
            if outside.any():
                step[outside] = np.clip(step, least, most)[outside]
                moving &= ~outside
                continue
        slope = gradient + information @ step
        inward = np.where(moving | insensitive, 0.0, np.where(step <= least, -slope, slope))
        if inward.max() <= 1e-9 * np.abs(gradient).max():
            break
        moving[int(np.argmax(inward))] = True
    return np.clip(point + step / scale, lower, upper) - point


@dataclass(frozen=True, kw_only=True, eq=False)
class Uncertainty:
    """Uncertainty of a least-squares estimate.

    Attributes:
        covariance: (n, n) of the estimate, with the coloured residuals.
        white: (n, n) the same for white residuals.
        undetermined: (n,) parameters with a component in a direction of (numerically) no information.
        null_projection: (n, n) projection of a displacement onto those directions.
    """

    covariance: Array
    white: Array
    undetermined: NDArray[np.bool_]
    null_projection: Array


def uncertainty(information: Array, coloured: Array, variance: float) -> Uncertainty:
    """Uncertainty of a least-squares estimate: (J'J)^-1 J'RJ (J'J)^-1 with the covariance R of the residuals.

    Args:
        information: (n, n) J'J.
        coloured: (n, n) J'RJ.
        variance: of the residuals.
    """
    bad = ~(np.isfinite(np.diag(information)) & np.isfinite(np.diag(coloured)))[:, None]  # overflowed: no information
    information, coloured = (np.where(bad | bad.T | ~np.isfinite(of), 0.0, of) for of in (information, coloured))
    diagonal = np.diag(information)
    scale = np.where(diagonal > 0.0, np.sqrt(np.maximum(diagonal, 1e-300)), 1.0)
    eigenvalues, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    lost = eigenvalues < 1e-12 * max(float(eigenvalues.max(initial=0.0)), 1e-300)
    inverse = (vectors[:, ~lost] / eigenvalues[~lost]) @ vectors[:, ~lost].T
    null_vectors = np.where(np.abs(vectors[:, lost]) > _ROUNDING, vectors[:, lost], 0.0)
    size = np.outer(scale, scale)
    power, along = np.linalg.eigh(coloured / size)
    half = inverse @ (along * np.sqrt(np.maximum(power, 0.0)))  # its square has no negative variance
    with np.errstate(over="ignore", invalid="ignore"):
        covariance, white = half @ half.T / size, variance * inverse / size
    return Uncertainty(
        covariance=covariance,
        white=white,
        undetermined=(np.abs(vectors[:, lost]) > 1e-3).any(axis=1) | (diagonal <= 0.0),
        null_projection=null_vectors @ null_vectors.T * np.outer(1.0 / scale, scale),
    )


def bounded_least_squares(information: Array, pull: Array, positive: tuple[bool, ...] = ()) -> Array:
    """(m,) least-squares coefficients of some regressors R for values y, those marked `positive` not below zero.

    There are few of them, so the ones that are zero at the optimum are found by enumeration (Lawson and Hanson 1974,
    ch. 23).

    Args:
        information: (m, m) R'R.
        pull: (m,) R'y.
        positive: (m,) or empty.
    """
    # The products of a regressor that is only rounding can violate the Cauchy-Schwarz inequality.
    size = np.sqrt(np.maximum(np.diag(information), 1e-280))
    scaled = np.clip(information / size / size[:, None], -1.0, 1.0)
    target, signed = np.where(np.diag(information) > 1e-280, pull / size, 0.0), np.flatnonzero(positive)
    best, most = np.zeros(size.size), -np.inf
    for zeros in chain.from_iterable(combinations(signed, count) for count in range(signed.size + 1)):
        kept = [place for place in range(size.size) if place not in zeros]
        found = np.zeros(size.size)
        found[kept] = np.linalg.lstsq(scaled[np.ix_(kept, kept)], target[kept], rcond=_RANK_TOLERANCE)[0]
        explained = float(found @ target)
        if np.all(found[signed] >= 0.0) and explained > most:
            best, most = found, explained
        if not zeros and np.isfinite(most):
            break
    return np.asarray(best / size)
