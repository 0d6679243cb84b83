"""A fitted model linearised along its log, to test for further torques or measurement errors (score test, Rao 1948).

Every effect defines the torque, or measurement error, of a small effect along the model's motion. Its signature is the
response of the innovations, projected orthogonally to the parameters of the model and the initial states.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from diagnosis.linear import Filter, linearised, score
from diagnosis.motion import motion_of
from diagnosis.nuisance import Nuisance
from identification.fit_result import Fit
from identification.problem import Problem
from plant.effects import Motion
from plant.effects.effect import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Screen:
    """A fitted model linearised along a log, to calculate signatures."""

    fit: Fit
    motion: Motion
    innovations: Array
    nuisance: Nuisance
    filters: tuple[Filter, ...]

    @classmethod
    @np.errstate(over="ignore", invalid="ignore")  # of a motion that grows without bound
    def of(cls, fit: Fit) -> Screen:
        """Linearise a fit."""
        problem = Problem.of(fit.log, fit.model, known=fit.known)
        predictions = problem.predictor.predict(fit.model.values, fit.initial, bandwidth=fit.bandwidth, width=0.0)
        innovations, nuisance = np.concatenate([p.innovations for p in predictions]), Nuisance.of(predictions)
        linear = tuple(
            linearised(fit.model, run, p, fit.bandwidth, substeps=problem.predictor.substeps, colour=problem.log.colour)
            for run, p in zip(problem.log.runs, predictions, strict=True)
        )
        scores = score(linear, nuisance.beyond(innovations)[:, None])
        return cls(
            fit=fit,
            motion=motion_of(fit, problem, predictions, fit.bandwidth, scores),
            innovations=innovations,
            nuisance=nuisance,
            filters=linear,
        )
