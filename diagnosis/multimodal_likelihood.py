"""Standard errors for a multimodal likelihood: the scatter of the estimates over parts of the log.

A fit ends at one of the local maxima by chance, and the curvature there says nothing about the others. Therefore each
fifth of the log is fitted separately, from similar shapes too. The fit of the whole log also ends at one maximum, so
the scatter is its standard error without division by the root of the number of parts.
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
_FEWEST = 3  # least number of fitted parts
_SHORTEST = 100  # samples of a part of a run


def on_its_best_peak(fit: Fit, without: Mapping[str, Fit]) -> Fit:
    """A fit with its chaotic effects at the best local maximum found, with standard errors that include the others.

    Args:
        fit: of all effects.
        without: for each effect the fit of the model less that effect.
    """
    chaotic = [effect.name for effect in fit.model.effects if effect.chaotic and effect.name in without]
    for name in chaotic:
        other = multistart_refit(without[name], fit, name)
        if {*other.unidentifiable} <= {*fit.unidentifiable}:  # else it has no place for another effect
            fit = other
    return with_scatter(fit) if chaotic else fit


def with_scatter(fit: Fit) -> Fit:
    """The fit with standard errors of the chaotic effects' parameters that include the other local maxima."""
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
    """Standard deviation of each parameter of an effect over parts of the log; empty if the log is too short."""
    found = in_threads(partial(_alone, fit.model.without_effect(effect.name), effect), _parts(fit.log))
    values = np.array([each for each in found if each is not None])
    if len(values) < _FEWEST:
        return {}
    names = (f"{effect.name}.{spec.name}" for spec in effect.parameters() if spec.fitted or effect.freed)
    return dict(zip(names, map(float, values.std(axis=0, ddof=1)), strict=True))


def _parts(log: Log) -> list[Log]:
    """Five logs, each with one fifth of every run; empty if these are too short."""
    if min(len(run) for run in log.runs) < _PARTS * _SHORTEST:
        return []
    return [
        replace(log, runs=tuple(run.slice(len(run) * k // _PARTS, len(run) * (k + 1) // _PARTS) for run in log.runs))
        for k in range(_PARTS)
    ]


def _alone(rest: ServoModel, effect: Effect, part: Log) -> Array | None:
    """Values of an effect fitted to a part of the log; a base fit frees only the inertia."""
    try:
        base = Problem.of(part, rest, fixed=[name for name in rest.names if name != "inertia"]).solve()
        begun = problem_near(base, base.model.with_effect(effect)).descend(base)
        own = best_similar_shape(base, begun, effect.name).model.effect(effect.name)
    except (Unidentifiable, BadParameter):
        return None
    if own is None:
        return None
    return np.array([getattr(own, spec.name) for spec in own.parameters() if spec.fitted or effect.freed])
