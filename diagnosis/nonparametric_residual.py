"""Non-parametric model of the unmodelled torque: curves, varying laws, loops and ripples.

The effects of the catalogue keep their values. Non-parametric effects are added one after the other, at most two. Each
must predict a part of the log that it was not fitted to better than the model without it, and its gain in
log-likelihood on the whole log must exceed the cost of its parameters.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from diagnosis.evidence.nonparametric_proposals import promising
from diagnosis.falsification import errors_of_many_steps
from diagnosis.holdout import cut
from diagnosis.levels import DECISIVE, SIGNIFICANT
from diagnosis.refit import fitted_from, fitted_to, problem_near
from diagnosis.score_test import Screen
from diagnosis.validation_split import split
from identification.fit_result import Fit
from identification.log import Log
from identification.problem import Problem
from identification.threads import in_threads
from plant.effects.effect import Array, Stage
from plant.effects.nonparametric import unnamed
from plant.effects.nonparametric_curve import Nonparametric
from plant.servo import ServoModel

_MOST = 2  # largest number of non-parametric effects: each further one is more easily found by chance
_LASTING = [kind for kind in unnamed.values() if not kind.clocked and kind.stage is not Stage.ACTUATOR]
"""Kinds that can be added: no curve over time, for it does not hold beyond the log, and no effect of the actuator."""
_AT_ONCE = 3  # kinds that are tried together; the best of them is taken


def with_curves(fit: Fit, base: Fit) -> Fit:
    """A fit with non-parametric effects added, as long as they improve it.

    Args:
        fit: with the effects of the catalogue.
        base: of the model without them.
    """
    named = [name for name in fit.model.names if name not in base.model.names]
    for _ in range(_MOST):
        better = _better(fit, named)
        if better is None:
            break
        fit = better
    return fit


def _better(fit: Fit, named: Collection[str]) -> Fit | None:
    """The fit with one more non-parametric effect that predicts better and exceeds its cost; None without one."""
    starts = [start for _, start in promising(Screen.of(fit), _LASTING)]
    if not starts:
        return None
    first, rest, _ = split(fit.log)
    less = fitted_to(first, fit)
    before = errors_of_many_steps(less.model, rest)
    for begin in range(0, len(starts), _AT_ONCE):
        tried = starts[begin : begin + _AT_ONCE]
        significance = in_threads(lambda start: _significance(less, start, rest, before), tried)
        significant = [start for start, sigmas in zip(tried, significance, strict=True) if sigmas > SIGNIFICANT]
        extended = in_threads(lambda start: _with_nonparametric(fit, named, start), significant)
        paying = [other for other in extended if other.converged and _log_bayes_factor(other, fit) > DECISIVE]
        if paying:
            return max(paying, key=lambda other: _log_bayes_factor(other, fit))
    return None


def _with_nonparametric(fit: Fit, named: Collection[str], start: Nonparametric) -> Fit:
    after = _beside(fit, start, named).descend(fit)
    return replace(after, parameters=tuple(fit[p.name] if p.name in named else p for p in after.parameters))


def _beside(fit: Fit, start: Nonparametric, held: Collection[str] = ()) -> Problem:
    return problem_near(fit, fit.model.with_effect(start.begun()), fixed=tuple(held))


def _log_bayes_factor(fit: Fit, than: Fit) -> float:
    """Gain in log-likelihood over a simpler fit, less 1/2 log(samples) for each added parameter (Schwarz)."""
    more = sum(fit.model.names[place] not in than.model.names for place in fit.free)
    return fit.log_likelihood - than.log_likelihood - 0.5 * more * float(np.log(fit.samples))


def _significance(less: Fit, start: Nonparametric, rest: Log, before: Array) -> float:
    """Gain in multi-step prediction on the rest of a log by one more effect, divided by its standard error.

    Args:
        less: the fit to the first part, without the effect.
        start: the effect; if the prediction is significantly worse after the first iterations, the fit ends there.
        rest: the rest of the log.
        before: (T,) squared errors there without the effect.
    """
    problem = _beside(less, start)
    begun = problem.begun(less, less.bandwidth)
    values, _ = problem.unpack(begun.point)
    significance = _sigmas(before, problem.model.with_values(values), rest)
    return (
        significance
        if significance < -SIGNIFICANT
        else _sigmas(before, fitted_from(less, problem, begun=begun).model, rest)
    )


def _sigmas(before: Array, model: ServoModel, rest: Log) -> float:
    """Gain in multi-step prediction over squared errors `before` (T,), divided by its standard error."""
    gain, std = cut(before, errors_of_many_steps(model, rest))
    return gain / std if std > 0.0 else 0.0
