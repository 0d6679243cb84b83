"""Predictions of a fitted model, linearised in its parameters and in small torques and measurement errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.linear import HUGE, Filter, linearised
from diagnosis.nuisance import Nuisance
from identification.fit_result import Fit
from identification.predictor import DIVERGED, Prediction, measured_state
from identification.problem import Problem
from identification.recording import Response
from plant.effects.effect import Array
from plant.servo import ServoModel


@dataclass(frozen=True, kw_only=True, eq=False)
class Linearised:
    """Linearised predictions of all runs with one observer.

    Attributes:
        predictions: prediction of each run with its Jacobian: the free parameters, then the initial states.
        innovations: (T,) of all runs.
        filters: linear filter of each run, from a torque or a measurement error to the innovations.
    """

    predictions: Sequence[Prediction]
    innovations: Array
    filters: tuple[Filter, ...]

    @classmethod
    def at(cls, fit: Fit, bandwidth: float) -> Linearised | None:
        """At a fit, with an observer of a bandwidth [rad/s]; None if the motion grows without bound."""
        problem, predictions = predicted(fit, fit.model, bandwidth)
        if not (is_bounded(predictions) and (fit.model.chaotic or _is_held(predictions, problem.log.response))):
            return None
        substeps, colour = problem.predictor.substeps, problem.log.colour
        filters = tuple(
            linearised(fit.model, run, p, bandwidth, substeps=substeps, colour=colour)
            for run, p in zip(problem.log.runs, predictions, strict=True)
        )
        return cls(
            predictions=predictions, innovations=np.concatenate([p.innovations for p in predictions]), filters=filters
        )

    def nuisance(self, without: Sequence[int] = ()) -> Nuisance:
        """Directions of the parameters, except those in `without`, and of the initial states."""
        kept = [row for row in range(self.predictions[0].jacobian.shape[1]) if row not in without]
        return Nuisance.of(
            [replace(p, jacobian=p.jacobian[:, kept]) for p in self.predictions] if without else self.predictions
        )

    def slopes(self, rows: Sequence[int]) -> Array:
        """(T, len(rows)) Jacobian of some parameters."""
        return np.vstack([p.jacobian[:, list(rows)] for p in self.predictions])

    def beyond_the_rest(self, rows: Sequence[int], without: Sequence[int] = ()) -> Array:
        """(T, len(rows)) Jacobian of some parameters, beyond all others except `without`, and beyond initial states."""
        return self.nuisance((*rows, *without)).beyond(self.slopes(rows))


def predicted(
    fit: Fit, model: ServoModel, bandwidth: float, *, sensitivities: bool = True
) -> tuple[Problem, list[Prediction]]:
    """A model predicted along a fit's log from its initial states."""
    problem = Problem.of(fit.log, model, known=fit.known)
    predictions = problem.predictor.predict(
        model.values, fit.initial_of(model), bandwidth=bandwidth, width=0.0, sensitivities=sensitivities
    )
    return problem, predictions


def _is_held(predictions: Sequence[Prediction], response: Response) -> bool:
    """Whether errors of the initial angle, or velocity, do not grow so far that they dominate all sensitivities."""
    if response == "torque":
        return True
    start = measured_state(response)
    return max(float(np.mean(p.jacobian[:, start - p.initials] ** 2)) for p in predictions) <= DIVERGED**2


def is_bounded(predictions: Sequence[Prediction]) -> bool:
    """Whether the innovations and their Jacobian are bounded."""
    return all(np.abs(p.jacobian).max(initial=0.0) < HUGE and np.abs(p.innovations).max() < HUGE for p in predictions)
