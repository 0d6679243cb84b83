"""The fit beside the discrepancy: where a set of effects is likeliest once the unnamed takes part.

Least squares let the parameters follow what no name explains. Beside the discrepancy the innovations count as

    e' (I - Q Q') e / s^2

(`Responses.directions`), which is minimised here within the same bounds, with the responses as they are at the
least-squares fit.
"""

from __future__ import annotations

import numpy as np

from diagnosis.evidence.discrepancy import Posterior, Responses
from identification.certainty import fit_of
from identification.fit_result import Fit
from identification.least_squares import Minimum, NormalEquations, minimise
from identification.over_runs import normal_equations, places
from identification.problem import Problem
from plant.effects.effect import Array

_ITERATIONS = 8
_TOLERANCE = 0.1  # rise of the log-likelihood that is not worth another pass
_MOVED = 1.0  # ... and that is not worth another linearisation


def at_mode(fit: Fit, responses: Responses, posterior: Posterior) -> Fit:
    """The fit at the mode; the same object where it is there already."""
    problem = Problem.of(fit.log, fit.model, known=fit.known)
    directions, prior = responses.directions(posterior.scale, posterior.variance)

    def evaluate(point: Array) -> NormalEquations:
        values, initial = problem.unpack(point)
        pieces = list(problem.predictor.pieces(values, initial, bandwidth=fit.bandwidth, width=0.0))
        plain = normal_equations(pieces, len(problem.log.runs))
        if not np.isfinite(plain.cost):
            return plain
        innovations = np.concatenate([piece.innovations for _, piece in pieces])
        taken = directions.T @ innovations
        left = innovations - directions @ taken
        gradient, across, first = np.zeros(point.size), np.zeros((taken.size, point.size)), 0
        for run, piece in pieces:
            rows = slice(first, first + piece.innovations.size)
            at = places(len(problem.free), run, len(problem.log.runs))
            gradient[at] += piece.jacobian.T @ left[rows]
            across[:, at] += directions[rows].T @ piece.jacobian
            first = rows.stop
        return problem.with_prior(
            NormalEquations(
                cost=float(left @ left) + float(np.sum((prior @ taken) ** 2)),
                gradient=gradient,
                information=plain.information - across.T @ across,
            ),
            point,
        )

    begin = problem.pack(fit.model.values, fit.initial)
    here = evaluate(begin)
    found = minimise(
        evaluate,
        begin,
        problem.lower,
        problem.upper,
        samples=fit.samples,
        iterations=_ITERATIONS,
        tolerance=_TOLERANCE,
        at_start=here,
    )
    if not here.cost > found.equations.cost * np.exp(2.0 * _MOVED / fit.samples):
        return fit
    plain = problem.linearise(found.point, fit.bandwidth, 0.0)
    ended = Minimum(point=found.point, equations=plain, converged=True, evaluations=found.evaluations)
    return fit_of(problem, fit.bandwidth, ended, fit.evaluations)
