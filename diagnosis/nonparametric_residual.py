"""Curves that carry an unmodelled torque, so that its gain is had without a name.

The named effects keep their values; a curve over one variable describes what they leave, and another what that leaves.
Each must pay for its parameters, and predict a part of the log that it was not fitted to better than the model without.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np

from diagnosis.falsification import SURELY, gain_of
from diagnosis.holdout import split
from diagnosis.refit import fitted_to, problem_near
from diagnosis.residual_torque import effects_over
from identification.fit_result import Fit
from plant.effects import Motion
from plant.effects.nonparametric import plain
from plant.effects.nonparametric_curve import Curve


def with_curves(fit: Fit, base: Fit, motion: Motion, variables: Collection[str]) -> Fit:
    """A fit with curves over some variables beside its effects, as many as pay.

    Args:
        fit: of the named effects.
        base: of the model without them.
        motion: of its model.
        variables: on which the unmodelled torque depends; over time nothing is carried, for it would not go on.
    """
    named = [name for name in fit.model.names if name not in base.model.names]
    while True:
        better = [other for other in _one_more(fit, named, motion, variables) if _worth(other, fit) > 0.0]
        best = max(better, key=lambda other: _worth(other, fit), default=None)
        if best is None or not _predicts_better(fit, best):
            return fit
        fit = best


def _one_more(fit: Fit, named: Collection[str], motion: Motion, variables: Collection[str]) -> Iterator[Fit]:
    for kind in plain.values():
        over = effects_over(kind.over, fit.log.axis)
        if over in variables and not kind.clocked and kind.beside(fit.model) and fit.log.shows(kind):
            carried = _carried(fit, named, motion, kind)
            if carried is not None:
                yield carried


def _carried(fit: Fit, named: Collection[str], motion: Motion, kind: type[Curve]) -> Fit | None:
    low, high = kind.reach(motion)
    if not high > low:
        return None
    problem = problem_near(fit, fit.model.with_effect(kind(low=low, high=high)), fixed=(*kind.shape(), *named))
    after = problem.descend(fit)
    lines = (fit[p.name] if p.name in named else p for p in after.parameters)
    return replace(after, parameters=tuple(lines)) if after.converged else None


def _worth(fit: Fit, than: Fit) -> float:
    """Log-likelihood that a fit gains over a simpler one, less half a log(samples) for each parameter (Schwarz)."""
    more = sum(fit.model.names[place] not in than.model.names for place in fit.free)
    return fit.log_likelihood - than.log_likelihood - 0.5 * more * float(np.log(fit.samples))


def _predicts_better(less: Fit, fit: Fit) -> bool:
    """Whether it does so several steps ahead, where the rest of the log tells both models their parameters."""
    first, rest, _ = split(fit.log)
    gain, std = gain_of(fitted_to(first, less), fitted_to(first, fit), rest)
    return gain > SURELY * std
