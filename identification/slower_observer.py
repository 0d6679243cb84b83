"""Fit of a base model that lacks a dominant effect, such as an end stop or a strong spring: with a slower observer.

For such a model the most likely observer follows the load whatever the torque is. Its innovations have no information
about the model, and a search that begins there finds no effect. With a slower observer the model errs more, but the
torque matters. It may still explain nothing if it drives another load: a load on a spring oscillates without it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from identification.fit_result import Fit
from identification.log import Log
from identification.noise import log_likelihood
from identification.prior_knowledge import PriorKnowledge
from identification.problem import Problem, first_states
from identification.regression import starting_values
from identification.standard_errors import fit_with_errors
from plant.servo import ServoModel


def behind_a_slower_observer(
    log: Log, model: ServoModel, known: PriorKnowledge, serves: Callable[[Fit], bool]
) -> Fit | None:
    """The fit with the fastest observer that leaves a parameter identifiable and serves; None without one.

    The bandwidth is halved from one over the sample time. The fit is a starting point and need not be converged.

    Args:
        log: measured runs.
        model: the starting point.
        known: prior knowledge of the parameters.
        serves: whether a fit can be used.
    """
    problem = Problem.of(log, model, known=known)
    begun = [model.values, *starting_values(log, model)]
    points = [np.clip(problem.pack(values, first_states(log)), problem.lower, problem.upper) for values in begun]
    bandwidth, slowest = 1.0 / log.runs[0].sample_time, 1.0 / max(run.duration for run in log.runs)
    while bandwidth > slowest:
        start = min(points, key=lambda point: problem.cost(point, bandwidth, 0.0))
        best = problem.minimise(start, bandwidth, 0.0)
        found = replace(fit_with_errors(problem, bandwidth, best, best.evaluations), converged=True)
        if found.failed is None and serves(found):
            return found
        bandwidth /= 2.0
    return None


def torque_log_likelihood_gain(fit: Fit) -> float:
    """Gain in log-likelihood of a fitted model from the measured torque, compared with its mean in each run."""
    still = tuple(replace(run, command=np.full_like(run.command, np.mean(run.command))) for run in fit.log.runs)

    def likelihood(log: Log) -> float:
        problem = Problem.of(log, fit.model, known=fit.known)
        cost = problem.cost(problem.pack(fit.model.values, fit.initial), fit.bandwidth, 0.0)
        return log_likelihood(cost, fit.samples)

    return likelihood(fit.log) - likelihood(replace(fit.log, runs=still))
