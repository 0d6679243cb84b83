"""Whether a better model is better on what it has not seen, before it is believed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from diagnosis.holdout import bounded, restarted_share, simulation_gain, standard_errors
from identification.fit_result import Fit
from identification.problem import Problem
from plant.effects.effect import Array

_SIGNIFICANT = 2.0  # standard errors
_LOUD = 100.0  # rise of the log-likelihood of which a quarter should show in a quarter of the record
_MORE = 1.1  # times the squared error, which is no matter of the states that a simulation is restarted from
_UNSEEN = 0.25  # share at the end of each run on which a winner must hold up without having been fitted to it


def holds_up(before: Fit, after: Fit, *, must_show: bool = False) -> bool:
    """Whether an extended model stands beside its predecessor on what neither was chosen by.

    The odds have decided on one-step predictions of the whole record. The free simulation must not get significantly
    worse; and predictions of the last part of each run, after a fit to the first part, neither, unless the simulation
    gets significantly better. An effect for which the record speaks loudly must show there too: one of the two must get
    significantly better, or, since an effect may act in a few places only, the simulation's error must be halved. So
    must what has no name to speak for it (`must_show`). Restarted every second, what speaks loudly must not err more:
    a simulation that has lost its run says little, and an observer helps a model that bends the wrong way.
    """
    simulation, left = simulation_gain(before, after)
    if simulation < -_SIGNIFICANT:
        return False
    loud = must_show or after.log_likelihood - before.log_likelihood > _LOUD
    if loud and restarted_share(before, after) > _MORE:
        return False
    if simulation > _SIGNIFICANT or left < 0.5:
        return True
    bandwidth = max(before.bandwidth, after.bandwidth)
    unseen = standard_errors(_unseen(after, bandwidth) - _unseen(before, bandwidth))
    return unseen > (_SIGNIFICANT if loud else -_SIGNIFICANT)


def lost_unseen(before: Fit, after: Fit) -> float:
    """By how much an extended model is less likely in the last part, each with the observer that it asks for."""
    return float(np.sum(_unseen(before, before.bandwidth) - _unseen(after, after.bandwidth)))


def _unseen(fit: Fit, bandwidth: float) -> Array:
    """(U,) log-likelihood of each sample in the last part of the runs, after a fit to the first part."""
    seen = replace(fit.log, runs=tuple(run.slice(0, int(len(run) * (1.0 - _UNSEEN))) for run in fit.log.runs))
    problem = Problem.of(seen, fit.model, fixed=fit.fixed)
    best = problem.minimise(problem.pack(fit.model.values, fit.initial), bandwidth, 0.0, iterations=5)
    values, initial = problem.unpack(best.point)
    variance = best.equations.cost / problem.samples
    whole = replace(problem.predictor, runs=fit.log.runs, free=())
    predictions = whole.predict(values, initial, bandwidth=bandwidth, width=0.0, sensitivities=False)
    pairs = zip(seen.runs, predictions, strict=True)
    unseen = bounded(np.concatenate([prediction.innovations[len(part) :] for part, prediction in pairs]))
    return np.asarray(-0.5 * unseen**2 / variance - 0.5 * np.log(variance))
