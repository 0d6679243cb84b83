"""Whether the torque of a log responds to the motion: then a loop is closed around it, or it was measured in one.

Past motion then predicts the torque better than the torque's own past does (Granger 1969; Schwarz 1978).
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from identification.log import Log
from identification.noise import ORDER
from plant.effects.effect import Array

_ROUNDING = 1e-18  # of the torque's power: a command that its past determines exactly


def torque_responds(log: Log) -> bool:
    """Whether the past 20 positions predict the torque beyond its own past 20 values."""
    now, own, motion = list[Array](), list[Array](), list[Array]()
    for run in log.runs:
        if len(run) > 3 * ORDER:
            torque, angle = (sliding_window_view(values, ORDER + 1) for values in (run.drive, run.output))
            now.append(torque[:, -1])
            own.append(torque[:, :-1])
            motion.append(angle[:, :-1] - angle[:, :1])
    if not now:
        return False
    target, columns = np.concatenate(now), np.column_stack((np.vstack(own), np.ones(sum(map(len, now)))))
    alone, beside = (_unexplained(target, each) for each in (columns, np.hstack((columns, np.vstack(motion)))))
    if alone <= _ROUNDING * float(target @ target):
        return False
    return bool(target.size * np.log(alone / max(beside, 1e-300)) > ORDER * np.log(target.size))


def _unexplained(target: Array, columns: Array) -> float:
    """Sum of squares that a regression on columns (T, M) leaves of values (T,)."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)  # whatever their units
    return float(np.sum((target - scaled @ np.linalg.lstsq(scaled, target, rcond=1e-12)[0]) ** 2))
