"""A fit beside the discrepancy: where parameters and unmodelled torque together are likeliest.

    |e(theta, f)|^2 / s^2 + |f / a|^2  ->  min

The unmodelled torque acts on the load meanwhile, so that the path stays with the log and friction turns where it
turned. Least squares alone let the parameters follow what no name explains.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from diagnosis.evidence.discrepancy import Posterior, Responses
from diagnosis.evidence.families import Families
from diagnosis.evidence.linearised import by_run
from identification.fit_result import Fit
from identification.least_squares import NormalEquations
from identification.predictor import Predictor
from identification.problem import Problem
from identification.standard_errors import fit_with_errors
from identification.sums_over_runs import normal_equations, places
from plant.effects.effect import Array

_ITERATIONS = 20
_TOLERANCE = 0.3  # rise of the log-likelihood that is not worth another pass


@dataclass(frozen=True, kw_only=True, eq=False)
class Beside(Problem):
    """A least-squares problem of which each point ends with the discrepancy's coefficients, in their deviations.

    Attributes:
        families: that the discrepancy is made of.
        shown: (T, K) responses to coefficients of one deviation, as they are where it begins.
        scale: (M + R,) deviations; K of them are not zero.
        variance: s^2 [rad^2].
    """

    families: Families
    shown: Array
    scale: Array
    variance: float

    @classmethod
    def of_fit(cls, fit: Fit, families: Families, responses: Responses, posterior: Posterior) -> Self:
        """Of the model of a fit, with the responses there."""
        plain = Problem.of(fit.log, fit.model, known=fit.known)
        own = {name: getattr(plain, name) for name in Problem.__dataclass_fields__}
        scale = posterior.scale
        unbounded = np.full(int(np.sum(scale > 0.0)), np.inf)
        own |= {"lower": np.append(plain.lower, -unbounded), "upper": np.append(plain.upper, unbounded)}
        shown = responses.columns[:, scale > 0.0] * scale[scale > 0.0]
        return cls(**own, families=families, shown=shown, scale=scale, variance=posterior.variance)

    def from_fit(self, fit: Fit, functions: Array) -> tuple[Fit, Array]:
        """Fit and coefficients (M,) of the torques at the mode, from those of a start."""
        torques, kept = len(functions), self.scale > 0.0
        deviations = np.zeros(len(self.scale))
        deviations[:torques][kept[:torques]] = functions[kept[:torques]] / self.scale[:torques][kept[:torques]]
        begin = np.append(self.pack(fit.model.values, fit.initial), deviations[kept])
        found = self.minimise(begin, fit.bandwidth, 0.0, _ITERATIONS, tolerance=_TOLERANCE)
        base, coefficients = self._divided(found.point)
        plain = Problem.of(fit.log, fit.model, known=fit.known)
        plain = replace(plain, predictor=self._predictor(coefficients))
        ended = replace(found, point=base, equations=plain.linearise(base, fit.bandwidth, 0.0))
        return fit_with_errors(plain, fit.bandwidth, ended, fit.evaluations), coefficients[:torques]

    def linearise(self, point: Array, bandwidth: float, width: float) -> NormalEquations:
        """The normal equations at a point."""
        base, coefficients = self._divided(point)
        values, initial = self.unpack(base)
        predictor = self._predictor(coefficients)
        pieces = list(predictor.pieces(values, initial, bandwidth=bandwidth, width=width))
        plain = normal_equations(pieces, len(self.log.runs))
        if not np.isfinite(plain.cost):
            return replace(plain, cost=np.inf)
        deviations = point[base.size :]
        readings = np.flatnonzero(self.scale) >= len(self.families.variables)
        told = np.concatenate([piece.innovations for _, piece in pieces])
        told -= self.shown[:, readings] @ deviations[readings]
        gradient, across, first = np.zeros(base.size), np.zeros((base.size, deviations.size)), 0
        for run, piece in pieces:
            rows = slice(first, first + piece.innovations.size)
            at = places(len(self.free), run, len(self.log.runs))
            gradient[at] += piece.jacobian.T @ told[rows]
            across[at] -= piece.jacobian.T @ self.shown[rows]
            first = rows.stop
        own = self.shown.T @ self.shown + self.variance * np.eye(deviations.size)
        found = NormalEquations(
            cost=float(told @ told) + self.variance * float(deviations @ deviations),
            gradient=np.append(gradient, self.variance * deviations - self.shown.T @ told),
            information=np.block([[plain.information, across], [across.T, own]]),
        )
        return self.with_prior(found, point)

    def _divided(self, point: Array) -> tuple[Array, Array]:
        """Parameters with initial states, and all coefficients (M + R,)."""
        count = int(np.sum(self.scale > 0.0))
        coefficients = self.scale.copy()
        coefficients[self.scale > 0.0] *= point[point.size - count :]
        return point[: point.size - count], coefficients

    def _predictor(self, coefficients: Array) -> Predictor:
        load = self.families.torque @ coefficients[: len(self.families.variables)]
        return replace(self.predictor, loads=by_run(self.log, load))
