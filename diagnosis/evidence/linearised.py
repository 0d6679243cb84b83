"""The predictions of a fitted model along its log, linearised in its parameters and in small torques and readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.linear import Linear, linearised
from diagnosis.nuisance import Nuisance
from identification.fit_result import Fit
from identification.log import Log
from identification.predictor import Prediction
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
        load: (T,) torque that acts on the load besides [N m].
    """

    told: Sequence[Prediction]
    innovations: Array
    filters: tuple[Linear, ...]
    load: Array

    @classmethod
    def at(cls, fit: Fit, bandwidth: float, load: Array) -> Linearised | None:
        """At a fit, behind an observer of a bandwidth [rad/s], while a torque (T,) acts on the load [N m].

        None where the motion grows without bound.
        """
        problem, told = predicted(fit, fit.model, bandwidth, load)
        if not is_bounded(told):
            return None
        substeps, colour = problem.predictor.substeps, problem.log.colour
        filters = tuple(
            linearised(fit.model, run, p, bandwidth, substeps=substeps, colour=colour, load=own)
            for run, p, own in zip(problem.log.runs, told, by_run(fit.log, load), strict=True)
        )
        return cls(told=told, innovations=np.concatenate([p.innovations for p in told]), filters=filters, load=load)

    def nuisance(self, without: Sequence[int] = ()) -> Nuisance:
        """What the parameters, but for those of some rows, and the initial states can follow."""
        kept = [row for row in range(self.told[0].jacobian.shape[1]) if row not in without]
        return Nuisance.of([replace(p, jacobian=p.jacobian[:, kept]) for p in self.told] if without else self.told)

    def beyond_the_rest(self, rows: Sequence[int]) -> Array:
        """(T, len(rows)) Jacobian of some parameters beyond all others and the initial states."""
        return self.nuisance(rows).beyond(np.vstack([p.jacobian[:, list(rows)] for p in self.told]))


def predicted(fit: Fit, model: ServoModel, bandwidth: float, load: Array) -> tuple[Problem, list[Prediction]]:
    """A model predicted along a fit's log from its initial states, while a torque (T,) acts on the load [N m]."""
    problem = Problem.of(fit.log, model, known=fit.known)
    predictor = replace(problem.predictor, loads=by_run(fit.log, load))
    return problem, predictor.predict(model.values, fit.initial, bandwidth=bandwidth, width=0.0)


def by_run(log: Log, values: Array) -> tuple[Array, ...]:
    """Values (T,) of all runs, run by run."""
    return tuple(np.split(values, np.cumsum([len(run) for run in log.runs])[:-1]))


def is_bounded(told: Sequence[Prediction]) -> bool:
    """Whether neither the motion nor what depends on it has run off."""
    return all(np.abs(p.jacobian).max(initial=0.0) < _HUGE and np.abs(p.innovations).max() < _HUGE for p in told)
