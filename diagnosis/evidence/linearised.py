"""The predictions of a fitted model along its log, linearised in its parameters and in small torques and readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.linear import Linear, linearised
from diagnosis.nuisance import Nuisance
from identification.fit_result import Fit
from identification.predictor import OUTGROWN, Prediction, measured_state
from identification.problem import Problem
from plant.effects.effect import Array
from plant.servo import ServoModel

_HUGE = 1e100  # what has overflowed, or will when it is squared


@dataclass(frozen=True, kw_only=True, eq=False)
class Linearised:
    """Of all runs behind one observer.

    Attributes:
        told: predictions with their Jacobians: the free parameters, then the initial states.
        innovations: (T,) of all of them.
        filters: what a torque or an error of the measurement does to the innovations.
    """

    told: Sequence[Prediction]
    innovations: Array
    filters: tuple[Linear, ...]

    @classmethod
    def at(cls, fit: Fit, bandwidth: float) -> Linearised | None:
        """At a fit, behind an observer of a bandwidth [rad/s]; None where the motion grows without bound."""
        problem, told = predicted(fit, fit.model, bandwidth)
        start = measured_state(problem.log.response)
        if not (is_bounded(told) and (fit.model.chaotic or _is_held(told, start))):
            return None
        substeps, colour = problem.predictor.substeps, problem.log.colour
        filters = tuple(
            linearised(fit.model, run, p, bandwidth, substeps=substeps, colour=colour)
            for run, p in zip(problem.log.runs, told, strict=True)
        )
        return cls(told=told, innovations=np.concatenate([p.innovations for p in told]), filters=filters)

    def nuisance(self, without: Sequence[int] = ()) -> Nuisance:
        """What the parameters, but for those of some rows, and the initial states can follow."""
        kept = [row for row in range(self.told[0].jacobian.shape[1]) if row not in without]
        return Nuisance.of([replace(p, jacobian=p.jacobian[:, kept]) for p in self.told] if without else self.told)

    def slopes(self, rows: Sequence[int]) -> Array:
        """(T, len(rows)) Jacobian of some parameters."""
        return np.vstack([p.jacobian[:, list(rows)] for p in self.told])

    def beyond_the_rest(self, rows: Sequence[int], without: Sequence[int] = ()) -> Array:
        """(T, len(rows)) Jacobian of some parameters beyond all others, but for those `without`, and initial states."""
        return self.nuisance((*rows, *without)).beyond(self.slopes(rows))


def predicted(
    fit: Fit, model: ServoModel, bandwidth: float, *, sensitivities: bool = True
) -> tuple[Problem, list[Prediction]]:
    """A model predicted along a fit's log from its initial states."""
    problem = Problem.of(fit.log, model, known=fit.known)
    told = problem.predictor.predict(
        model.values, fit.initial, bandwidth=bandwidth, width=0.0, sensitivities=sensitivities
    )
    return problem, told


def _is_held(told: Sequence[Prediction], start: int) -> bool:
    """Whether errors of the initial angle, or velocity, do not grow so far that nothing else is seen of the slopes."""
    return max(float(np.mean(p.jacobian[:, start - 2] ** 2)) for p in told) <= OUTGROWN**2


def is_bounded(told: Sequence[Prediction]) -> bool:
    """Whether neither the motion nor what depends on it has run off."""
    return all(np.abs(p.jacobian).max(initial=0.0) < _HUGE and np.abs(p.innovations).max() < _HUGE for p in told)
