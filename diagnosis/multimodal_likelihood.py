"""Standard errors where the likelihood is a mountain range: by how much parts of the log disagree.

Which of the peaks a fit has climbed is chance, and the curvature of that one says nothing of the others. Each fifth of
the log is therefore fitted by itself, among the shapes that look alike too. A fit of the whole stands on one peak as
each of them does: their scatter is its standard error, not divided by the root of their number.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from diagnosis.multistart import best_similar_shape, multistart_refit
from diagnosis.refit import problem_near
from identification.errors import Unidentifiable
from identification.fit_result import Fit
from identification.log import Log
from identification.problem import Problem
from identification.threads import in_threads
from plant.effects import Effect
from plant.effects.effect import Array
from plant.errors import BadParameter
from plant.servo import ServoModel

_PARTS = 5
_FEWEST = 3  # parts whose scatter says something
_SHORTEST = 100  # samples of a part of a run


def on_its_best_peak(fit: Fit, without: Mapping[str, Fit]) -> Fit:
    """A fit whose chaotic effects stand on the best peak that is found, with standard errors that know of the others.

    Args:
        fit: of all effects.
        without: for each effect the fit of the model less that effect.
    """
    chaotic = [effect.name for effect in fit.model.effects if effect.chaotic and effect.name in without]
    for name in chaotic:
        fit = multistart_refit(without[name], fit, name)
    return with_scatter(fit) if chaotic else fit


def with_scatter(fit: Fit) -> Fit:
    """The fit with standard errors of its chaotic effects' parameters that know of the other peaks."""
    stds = {
        name: std
        for effect in fit.model.effects
        if effect.chaotic
        for name, std in scatter_over_parts(fit, effect).items()
    }
    lines = (
        line if line.std is None or line.name not in stds else replace(line, std=max(line.std, stds[line.name]))
        for line in fit.parameters
    )
    return replace(fit, parameters=tuple(lines))


def scatter_over_parts(fit: Fit, effect: Effect) -> dict[str, float]:
    """Standard deviation over parts of the log of each parameter of an effect in a fit; none of too short a log."""
    found = in_threads(partial(_alone, fit.model.without_effect(effect.name), effect), _parts(fit.log))
    values = np.array([each for each in found if each is not None])
    if len(values) < _FEWEST:
        return {}
    names = (f"{effect.name}.{spec.name}" for spec in effect.parameters() if spec.fitted or effect.freed)
    return dict(zip(names, map(float, values.std(axis=0, ddof=1)), strict=True))


def _parts(log: Log) -> list[Log]:
    """The log with the first fifth of each run, with the second, and so on; none where that is too short."""
    if min(len(run) for run in log.runs) < _PARTS * _SHORTEST:
        return []
    return [
        replace(log, runs=tuple(run.slice(len(run) * k // _PARTS, len(run) * (k + 1) // _PARTS) for run in log.runs))
        for k in range(_PARTS)
    ]


def _alone(rest: ServoModel, effect: Effect, part: Log) -> Array | None:
    """Fitted values of an effect in a part of the log, the rest of the model but for its inertia as it is."""
    try:
        base = Problem.of(part, rest, fixed=[name for name in rest.names if name != "inertia"]).solve()
        begun = problem_near(base, base.model.with_effect(effect)).descend(base)
        own = best_similar_shape(base, begun, effect.name).model.effect(effect.name)
    except (Unidentifiable, BadParameter):
        return None
    if own is None:
        return None
    return np.array([getattr(own, spec.name) for spec in own.parameters() if spec.fitted or effect.freed])
