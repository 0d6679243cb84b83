"""Friction from a regression over windows of a log.

Outlying windows count less (Huber 1964). The Bayesian information criterion (Schwarz 1978) selects the effects.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from identification.errors import Unidentifiable
from plant.effects.effect import Array

_HUBER = 1.345  # standard deviations beyond which a window counts less: 95 % efficient on Gaussian noise
_SCALES = np.geomspace(0.01, 0.5, 12)  # Stribeck velocities that are tried, relative to the top speed
_SIGNIFICANT = 5.0  # times its error: change of the velocity in windows from which an inertia is estimated
_SEEN = 0.1  # least fraction of the Stribeck friction that some window must show: below it, it is extrapolated
_STEPS = 20  # iterations that refine the Stribeck velocity


@dataclass(frozen=True, kw_only=True, eq=False)
class Regression:
    """Least squares of the torque of windows.

    Attributes:
        values, std: of the coefficients, by name.
        columns: (W,) regressor of each coefficient.
        residual: rms of the residuals [N m].
        spread: mean square of the residuals, with less weight for outlying windows (Huber).
        independent: number of independent windows, from the correlation of neighbouring residuals.
    """

    values: dict[str, float]
    std: dict[str, float]
    columns: dict[str, Array]
    residual: float
    spread: float
    independent: float


def best_of(found: list[Regression]) -> Regression:
    """The best by the Bayesian information criterion, with the number of independent windows of the closest fit."""
    if not found:
        raise Unidentifiable(
            "Friction cannot be separated from inertia and gravity in this log; record slow and fast speeds, both ways."
        )
    count = min(found, key=lambda one: one.spread).independent
    return min(found, key=lambda one: count * np.log(one.spread) + len(one.values) * np.log(count))


def candidates(rows: dict[str, Array], one_way: bool, rotary: bool) -> Iterable[Regression]:
    """One regression for each combination of inertia, gravity and Stribeck velocity."""
    v = rows["velocity"]
    always = {"coulomb": np.sign(v), "viscous": v}
    if not one_way:
        always["offset"] = np.ones_like(v)
    with_inertia = np.std(rows["change"]) > _SIGNIFICANT * np.sqrt(2.0) * np.median(rows["velocity_error"])
    scales = [0.0, *(_SCALES * np.max(np.abs(v)))]
    for inertia, gravity, scale in product(
        (False, True) if with_inertia else (False,), (False, True) if rotary else (False,), scales
    ):
        columns = dict(always)
        if inertia:
            columns["inertia"] = rows["acceleration"]
        if gravity:
            columns |= {"gravity": rows["cos"], "gravity_quadrature": rows["sin"]}
        if scale:
            columns["excess"] = _hump(rows, scale)
        found = _fitted(columns, rows["torque"])
        if found is not None and (not scale or _rises_to_breakaway(found)):
            yield replace(found, values=found.values | ({"stribeck_velocity": float(scale)} if scale else {}))


def _rises_to_breakaway(found: Regression) -> bool:
    """Whether the fitted Stribeck curve is one of friction, which brakes when sliding and more before, and is seen."""
    seen = np.max(np.abs(found.columns["excess"])) >= _SEEN
    return bool(seen and found.values["excess"] > 0.0 and found.values["coulomb"] >= 0.0)


def _hump(rows: dict[str, Array], scale: float) -> Array:
    """Mean of the Stribeck curve over the velocities in each window, by Simpson's rule."""
    v, half = rows["velocity"], 0.5 * rows["change"]
    slow, middle, fast = (np.exp(-(((v + part) / scale) ** 2)) for part in (-half, 0.0, half))
    return np.asarray(np.sign(v) * (slow + 4.0 * middle + fast) / 6.0)


def refined(found: Regression, rows: dict[str, Array]) -> Regression:
    """The regression with a Stribeck velocity refined by Gauss-Newton steps, and its standard error."""
    best, scale = found, found.values.get("stribeck_velocity", 0.0)
    speed = np.abs(rows["velocity"])
    for _ in range(_STEPS if scale else 0):
        columns = dict(best.columns)
        columns["excess"] = _hump(rows, scale)
        slope = 2.0 * best.values["excess"] * columns["excess"] * speed**2 / scale**3
        tried = _fitted(columns | {"stribeck_velocity": slope}, rows["torque"])
        if tried is None or not _rises_to_breakaway(tried):
            return found
        scale *= float(np.exp(np.clip(tried.values["stribeck_velocity"] / scale, -0.3, 0.3)))
        best = replace(tried, values=tried.values | {"stribeck_velocity": scale}, columns=columns)
    return best if best.spread <= found.spread else found


def _fitted(columns: dict[str, Array], torque: Array) -> Regression | None:
    """Huber's regression; None if the regressors are collinear or too many for the windows that count."""
    matrix = np.column_stack(list(columns.values()))
    scale = np.linalg.norm(matrix, axis=0)
    if torque.size <= matrix.shape[1] + 1 or np.any(scale == 0.0):
        return None
    scaled = matrix / scale
    if np.linalg.cond(scaled) > 1e3:
        return None
    weights = np.ones_like(torque)
    for _ in range(20):
        solution = np.linalg.lstsq(scaled * np.sqrt(weights)[:, None], torque * np.sqrt(weights), rcond=None)[0]
        off = torque - scaled @ solution
        sigma = max(1.4826 * float(np.median(np.abs(off))), 1e-12 * float(np.max(np.abs(torque))))
        weights = np.minimum(1.0, _HUBER * sigma / np.maximum(np.abs(off), 1e-300))
    if np.sum(weights) < 2 * len(columns):  # as many as that can be met almost exactly, and the others are outliers
        return None
    memory = float(np.clip(np.corrcoef(off[1:], off[:-1])[0, 1], 0.0, 0.95)) if np.ptp(off) > 0.0 else 0.0
    independent = torque.size * (1.0 - memory) / (1.0 + memory)
    spread = float(np.sum(weights * off**2)) / np.sum(weights)
    covariance = spread * np.linalg.inv((scaled * weights[:, None]).T @ scaled) * torque.size / independent
    size = np.abs(off)
    huber = np.where(size <= _HUBER * sigma, off**2, 2.0 * _HUBER * sigma * size - (_HUBER * sigma) ** 2)
    return Regression(
        values={name: float(value) for name, value in zip(columns, solution / scale, strict=True)},
        std={name: float(value) for name, value in zip(columns, np.sqrt(np.diag(covariance)) / scale, strict=True)},
        columns=columns,
        residual=float(np.sqrt(np.mean(off**2))),
        spread=max(float(np.mean(huber)), 1e-300),
        independent=max(independent, 2.0),
    )
