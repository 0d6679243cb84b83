"""Does something remain that has no name? Curves over one variable compete with the catalogue on the same footing."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline

from diagnosis.odds import schwarz_cost, score
from diagnosis.screen import Screen
from plant.effects import Motion, TorqueOffset, Trace
from plant.effects.effect import Array

_KNOTS = 8
_CLEARS = np.log(1000.0)  # score that a curve needs before it is believed


def unnamed_dependence(screen: Screen) -> tuple[tuple[str, float], ...]:
    """Variables over which a smooth curve of missing torque would explain more than chance, with the curve's score.

    Over velocity the curve has a jump at zero besides, so that dry friction does not pass for a smooth curve's failure.
    """
    motion = screen.motion
    linear = screen.fit.log.axis == "linear"
    variables = {
        "velocity": motion.velocity,
        "position" if linear else "angle": motion.angle,
        "force" if linear else "torque": motion.torque,
        "time": motion.time + 0.0,
    }
    names = [name for name, values in variables.items() if np.ptp(values) > 0.0]
    traces = [_trace(_columns(name, variables[name], motion)) for name in names]
    found = {}
    for name, trace, (evidence, _) in zip(names, traces, screen.regress(traces, discounted=True), strict=True):
        found[name] = score(
            evidence,
            cost=schwarz_cost(trace.columns.shape[1], screen.fit.samples),
            searched=1,
            catalogue=len(names),
        )
    clearing = [(name, value) for name, value in found.items() if value > _CLEARS]
    return tuple(sorted(clearing, key=lambda item: -item[1]))


def _columns(name: str, values: Array, motion: Motion) -> Array:
    basis = spline_basis(values)
    return np.column_stack((basis, motion.sign)) if name == "velocity" else basis


def _trace(columns: Array) -> Trace:
    return Trace(columns=columns, start=lambda c: TorqueOffset(torque=0.0))


def spline_basis(values: Array, knots: int = _KNOTS) -> Array:
    """(T, knots) cubic B-splines over the range that holds 99 % of the values; flat outside."""
    low, high = np.quantile(values, [0.005, 0.995])
    if not high > low:
        return np.zeros((values.size, 0))
    inner = np.linspace(low, high, knots - 2)
    grid = np.concatenate(([low] * 3, inner, [high] * 3))
    return np.asarray(BSpline.design_matrix(np.clip(values, low, high), grid, 3).toarray())
