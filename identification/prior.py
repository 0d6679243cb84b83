"""Gaussian prior of the parameters: the knowledge of the user, and the smoothness of non-parametric curves.

The heights of such a curve have the scale of the torque. Where the log has no data, between the few commanded torques
or at speeds that the load passes quickly, only the prior determines the curve; least squares alone would diverge there.
Where the log has data, they outweigh the prior (Wahba 1990, ch. 1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.log import Log
from identification.prior_knowledge import PriorKnowledge
from plant.effects.effect import Array
from plant.effects.nonparametric_curve import Curve
from plant.servo import ServoModel

_KNOT_VARIANCE = 0.1  # variance of a knot independent of its neighbours, over the variance of all knots


def natural_scales(log: Log) -> dict[str, float]:
    """Typical size of an effect's parameter on a log, by its kind of quantity (`ServoModel.quantities`)."""
    torque = np.concatenate([run.drive for run in log.runs])
    level = float(np.sqrt(np.nanmean(torque**2)))
    speeds = np.concatenate([np.gradient(run.output, run.time) for run in log.runs])
    speed = float(np.sqrt(np.nanmean(speeds**2)))
    viscous = level / speed if speed > 0.0 else 0.0
    return {"rad": 1.0, "N m": level, "N": level, "N m s/rad": viscous, "N s/m": viscous}


@dataclass(frozen=True, kw_only=True, eq=False)
class Prior:
    """A Gaussian: its mean (F,) and its inverse covariance (F, F), zero without prior knowledge."""

    mean: Array
    precision: Array

    def pull(self, values: Array) -> Array:
        """(F,) gradient of half the squared distance of parameters (F,) from the mean."""
        return np.asarray(self.precision @ (values - self.mean))

    def distance(self, values: Array) -> float:
        """Squared distance of parameters (F,) from the mean, in standard deviations."""
        return float((values - self.mean) @ self.pull(values))


def prior(log: Log, model: ServoModel, free: tuple[int, ...], known: PriorKnowledge) -> Prior | None:
    """The prior of the free parameters; None without any prior knowledge of them."""
    rows = {model.names[place]: row for row, place in enumerate(free)}
    mean, precision = np.zeros(len(free)), _smoothness(log, model, free, rows)
    for name in known.prior.keys() & rows.keys():
        mean[rows[name]], std = known.prior[name]
        precision[rows[name], rows[name]] += 1.0 / std**2
    return Prior(mean=mean, precision=precision) if precision.any() else None


def _smoothness(log: Log, model: ServoModel, free: tuple[int, ...], rows: dict[str, int]) -> Array:
    """(F, F) inverse covariance of the heights of non-parametric curves, whose prior mean is zero."""
    curves = [effect for effect in model.effects if isinstance(effect, Curve)]
    known, scales = np.zeros((len(free), len(free))), natural_scales(log) if curves else {}
    for curve in curves:
        names = [f"{curve.name}.{spec.name}" for spec in curve.parameters()]
        at = [rows[name] for name in names if name in rows and name not in curve.shape()]
        if len(at) == len(curve.prior):
            size = scales.get(model.quantities[free[at[0]]]) or 1.0
            known[np.ix_(at, at)] = np.linalg.inv(curve.prior + _KNOT_VARIANCE * np.eye(len(at))) / size**2
    return known
