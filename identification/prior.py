"""What is known of a curve without a name before a log is seen: it is about as high as the torque, and smooth.

Where a log is silent, between the few torques that were commanded or at speeds that it passes in no time, nothing else
holds a curve, and least squares would send it anywhere. What the log does say outweighs this (Wahba 1990, ch. 1).
"""

from __future__ import annotations

import numpy as np

from identification.log import Log
from plant.effects.curve import Curve
from plant.effects.effect import Array
from plant.servo import ServoModel

_BENT = 0.1  # variance of a knot beside those about it, over that of them all


def natural_scales(log: Log) -> dict[str, float]:
    """By the kind of quantity (`ServoModel.quantities`), the size that one of an effect can have on a log."""
    torque = np.concatenate([run.drive for run in log.runs])
    level = float(np.sqrt(np.nanmean(torque**2)))
    speeds = np.concatenate([np.gradient(run.output, run.time) for run in log.runs])
    speed = float(np.sqrt(np.nanmean(speeds**2)))
    viscous = level / speed if speed > 0.0 else 0.0
    return {"rad": 1.0, "N m": level, "N": level, "N m s/rad": viscous, "N s/m": viscous}


def precision(log: Log, model: ServoModel, free: tuple[int, ...]) -> Array | None:
    """(F, F) inverse covariance of the free parameters before the log is seen; None of a model without curves."""
    curves = [effect for effect in model.effects if isinstance(effect, Curve)]
    if not curves:
        return None
    scales, rows = natural_scales(log), {model.names[place]: row for row, place in enumerate(free)}
    known = np.zeros((len(free), len(free)))
    for curve in curves:
        names = [f"{curve.name}.{spec.name}" for spec in curve.parameters()]
        at = [rows[name] for name in names if name in rows and name not in curve.shape()]
        if len(at) == len(curve.prior):
            size = scales.get(model.quantities[free[at[0]]]) or 1.0
            known[np.ix_(at, at)] = np.linalg.inv(curve.prior + _BENT * np.eye(len(at))) / size**2
    return known
