"""The missing torque: what a fitted model would have needed besides the command to follow the measurement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plant.effects.effect import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """The missing torque as a function of one variable.

    Attributes:
        variable: "velocity", "angle", "torque" or "time".
        unit: of the variable.
        centre, mean, band: (B,) middle of each bin, mean missing torque in it and its standard error [N m].
        share: of the missing torque's variance that this variable alone explains, less what chance would [-].
    """

    variable: str
    unit: str
    centre: Array
    mean: Array
    band: Array
    share: float


@dataclass(frozen=True, kw_only=True, eq=False)
class MissingTorque:
    """Smoothed load torque that a model lacks, over a log.

    Attributes:
        time, torque, band: (T,) [s], [N m], half width of the 95 % band [N m].
        angle, velocity, command: (T,) filtered motion and the torque command [rad, rad/s, N m].
        run: (T,) index of the run.
        curves: over velocity, angle, torque and time, the most telling first.
        unit: of the torque.
    """

    time: Array
    torque: Array
    band: Array
    angle: Array
    velocity: Array
    command: Array
    run: NDArray[np.intp]
    curves: tuple[Curve, ...]
    unit: str
