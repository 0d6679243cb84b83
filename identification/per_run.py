"""Parameters that differ from run to run, fitted together with the parameters that all runs share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identification.coloured_noise import with_coloured_noise
from identification.fit_result import Fit, FittedParameter
from identification.least_squares import Minimum, NormalEquations, minimise, uncertainty
from identification.log import Log
from identification.objective import Objective
from identification.predictor import Prediction
from identification.problem import Problem
from identification.sums_over_runs import informations, normal_equations, places
from identification.time_stamp_jitter import with_its_clock
from plant.effects.effect import Array

_ROUNDS = 3  # alternations between the parameters of the runs and the observer


@dataclass(frozen=True, kw_only=True, eq=False)
class PerRun:
    """An objective in which the rows `own` of the free parameters differ from run to run."""

    objective: Objective
    own: tuple[int, ...]

    @classmethod
    def of(cls, fit: Fit, names: Sequence[str]) -> PerRun:
        """The objective of a fit in which the parameters of these names differ from run to run."""
        objective = Objective.of(fit.log, fit.model, fixed=fit.fixed)
        rows = [objective.model.names[place] for place in objective.free]
        return cls(objective=objective, own=tuple(rows.index(name) for name in names))

    def places(self, run: int) -> NDArray[np.intp]:
        """(F + I,) indices of a run's parameters and initial state in a point."""
        objective, initials = self.objective, len(self.objective.predictor.fitted_starts)
        return places(len(objective.free), run, len(objective.log.runs), self.own, initials)

    def alone(self, run: int) -> Objective:
        """The objective of one run, whose point is the part of that run."""
        one = self.objective.log.runs[run : run + 1]
        log, predictor = replace(self.objective.log, runs=one), replace(self.objective.predictor, runs=one)
        return replace(self.objective, log=log, predictor=predictor)

    def begun(self, fit: Fit) -> Array:
        """The point in which all runs have the values of a fit."""
        point = np.empty(int(self.places(len(fit.initial) - 1).max()) + 1)
        for run, initial in enumerate(fit.initial):
            point[self.places(run)] = self.alone(run).pack(fit.model.values, initial[None, :])
        return point

    def predictions(self, point: Array, bandwidth: float) -> list[Prediction]:
        """Predictions of all runs, each with its parameters."""
        found = []
        for run in range(len(self.objective.log.runs)):
            alone = self.alone(run)
            found += alone.predictor.predict(*alone.unpack(point[self.places(run)]), bandwidth=bandwidth, width=0.0)
        return found

    def minimise(self, start: Array, bandwidth: float, iterations: int = 20) -> Minimum:
        """The best point (`identification.sums_over_runs`) at a bandwidth."""
        lower, upper = np.full(start.size, -np.inf), np.full(start.size, np.inf)
        count, runs = len(self.objective.free), len(self.objective.log.runs)
        for run in range(runs):
            at = self.places(run)[:count]
            lower[at], upper[at] = self.objective.lower[:count], self.objective.upper[:count]

        def linearise(point: Array, most: float) -> NormalEquations:
            return normal_equations(enumerate(self.predictions(point, bandwidth)), runs, self.own)

        return minimise(linearise, start, lower, upper, samples=self.objective.samples, iterations=iterations)

    def values(self, point: Array) -> Array:
        """(R, M) the values of each run in a point."""
        own = list(self.own)
        return np.array([point[self.places(run)][own] for run in range(len(self.objective.log.runs))])

    def covariance(self, point: Array, bandwidth: float) -> Array:
        """Covariance of a point with coloured innovations; the variance of an undetermined parameter is infinite."""
        predictions = self.predictions(point, bandwidth)
        power = float(sum(p.innovations @ p.innovations for p in predictions))
        variance = power / max(self.objective.samples - point.size, 1)
        found = uncertainty(*informations(predictions, self.own), variance)
        spread = found.covariance.copy()
        spread[found.undetermined, found.undetermined] = np.inf
        return spread


def fit_apart(first: Fit, names: tuple[str, ...]) -> Fit:
    """A fit of several runs in which these parameters differ from run to run, from a fit with common parameters.

    It alternates between all parameters at a given observer, and the observer, noise colour and shared parameters at
    given differences between the runs.
    """
    found = first
    for _ in range(_ROUNDS):
        problem = PerRun.of(found, names)
        best = problem.minimise(problem.begun(found), found.bandwidth)
        values, spread = problem.values(best.point), problem.covariance(best.point, found.bandwidth)
        std = np.sqrt(np.array([np.diag(spread)[problem.places(run)[list(problem.own)]] for run in range(len(values))]))
        at = [found.model.names.index(name) for name in names]
        if np.all(np.abs(values - found.model.values[at]) <= 0.1 * std + 1e-9 * np.abs(values)):
            break
        means = found.model.values
        means[at] = values.mean(axis=0)
        log, model = _moved_apart(found.log, names, values), found.model.with_values(means)
        starts = [problem.alone(run).unpack(best.point[problem.places(run)])[1] for run in range(len(values))]
        begun = replace(found, log=log, model=model, initial=np.vstack(starts))
        found = with_coloured_noise(with_its_clock(Problem.of(log, model, fixed=found.fixed).descend(begun)))
    return replace(found, parameters=_lines(found, first, problem, np.sqrt(np.diag(spread))))


def _moved_apart(log: Log, names: Sequence[str], values: Array) -> Log:
    """The log in which `Run.own` includes the differences of values (R, M) from their mean over the runs."""
    beyond = values - values.mean(axis=0)
    runs = []
    for run, more in zip(log.runs, beyond, strict=True):
        own = dict(run.own)
        for name, value in zip(names, more, strict=True):
            own[name] = own.get(name, 0.0) + float(value)
        runs.append(replace(run, own=own))
    return replace(log, runs=tuple(runs))


def _lines(found: Fit, first: Fit, problem: PerRun, std: Array) -> tuple[FittedParameter, ...]:
    """One line per shared parameter, and one line per run for each of the others.

    Args:
        found: the fit with all differences between the runs.
        first: the fit with common parameters, with payloads only; its starting values are reported.
        problem: has the indices of the parameters in the joint fit.
        std: standard errors of the joint fit.
    """
    rows = {found.model.names[place]: row for row, place in enumerate(found.free)}
    lines: list[FittedParameter] = []
    for line in found.parameters:
        if line.name not in rows or line.value is None:
            lines.append(line)
            continue
        row, line = rows[line.name], replace(line, start=first[line.name].start)
        if row not in problem.own:
            lines.append(replace(line, std=float(std[problem.places(0)[row]])))
            continue
        for run, (one, before) in enumerate(zip(found.log.runs, first.log.runs, strict=True)):
            more = one.own.get(line.name, 0.0) - before.own.get(line.name, 0.0)
            own = replace(line, name=f"{line.name}[{one.label}]", value=found.model.values[found.free[row]] + more)
            lines.append(replace(own, std=float(std[problem.places(run)[row]])))
    return tuple(lines)
