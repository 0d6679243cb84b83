"""Hidden initial states: the torque behind a lag, the twist of a shaft, the measurement of a slow sensor.

A run that begins at rest begins with these states settled, and that is what a fit assumes. A run that was cut out of a
motion does not. The model's first errors are then large whatever its parameters are, and a fit would follow them. So
the hidden initial states of all runs are fitted too where the log shows that they are not settled (Schwarz 1978).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from identification.least_squares import Minimum
from identification.noise import log_likelihood
from identification.objective import Objective
from identification.predictor import Prediction
from plant.effects.effect import Array

Fitted = TypeVar("Fitted", bound=Objective)
_ASIDE = 1e-3  # of the range of a state: step of a difference
_RANK_TOLERANCE = 1e-9  # relative singular value below which two states act alike


def hidden_starts(objective: Objective) -> int:
    """Number of hidden initial states, of all runs, among the unknowns of an objective."""
    return max(len(objective.predictor.fitted_starts) - 2, 0) * len(objective.log.runs)


def charge(objective: Objective) -> float:
    """Loss of log-likelihood for the hidden initial states of an objective, half the log of the samples for each."""
    return 0.5 * hidden_starts(objective) * float(np.log(objective.samples))


def unsettled_if_shown(settled: Fitted, minimum: Minimum, bandwidth: float) -> tuple[Fitted, Minimum]:
    """An objective and its minimum with hidden initial states if the log shows these, else both unchanged.

    Args:
        settled: the objective.
        minimum: at which the hidden states begin settled.
        bandwidth: of the observer [rad/s].
    """
    free = _with_hidden_states(settled)
    if free.predictor.fitted_starts == settled.predictor.fitted_starts or not np.isfinite(minimum.equations.cost):
        return settled, minimum
    least = log_likelihood(minimum.equations.cost, settled.samples) + charge(free)
    if not log_likelihood(_promised(free, *settled.unpack(minimum.point), bandwidth), free.samples) > least:
        return settled, minimum
    best = free.minimise(free.pack(*settled.unpack(minimum.point)), bandwidth, 0.0)
    if not log_likelihood(best.equations.cost, free.samples) > least:
        return settled, minimum
    return free, replace(best, evaluations=minimum.evaluations + best.evaluations)


def _with_hidden_states(objective: Fitted) -> Fitted:
    """The objective with the hidden initial states of all runs among its unknowns."""
    log, predictor = replace(objective.log, unsettled=True), replace(objective.predictor, unsettled=True)
    unbounded, free = np.full(len(predictor.fitted_starts) * len(log.runs), np.inf), len(objective.free)
    lower, upper = (
        np.concatenate((own[:free], side * unbounded)) for own, side in ((objective.lower, -1), (objective.upper, 1))
    )
    return replace(objective, log=log, predictor=predictor, lower=lower, upper=upper)


def _promised(free: Objective, values: Array, initial: Array, bandwidth: float) -> float:
    """Cost with the best initial states, linearised about settled ones (R, 2), with the same parameters (P,).

    Differences of predictions need no sensitivities, for which most models would be compiled in vain.
    """

    def predicted(begun: Array) -> list[Prediction]:
        return free.predictor.predict(values, begun, bandwidth=bandwidth, width=0.0, sensitivities=False)

    begun = np.pad(initial, ((0, 0), (0, len(free.model.states) - 2)))
    here = predicted(begun)
    steps = _ASIDE * np.diag(np.ptp(np.hstack([one.states for one in here]), axis=1))
    moved = [predicted(begun + steps[place]) for place in free.predictor.fitted_starts]
    cost = 0.0
    for run, one in enumerate(here):
        columns = np.column_stack([each[run].innovations - one.innovations for each in moved])
        columns[:, ~np.isfinite(columns).all(axis=0)] = 0.0  # a motion that grows without bound
        columns /= np.maximum(np.abs(columns).max(axis=0), 1e-300)  # the squares of a large motion may overflow
        columns /= np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        best = np.linalg.lstsq(columns, one.innovations, rcond=_RANK_TOLERANCE)[0]
        cost += float(np.sum((one.innovations - columns @ best) ** 2))
    return cost
