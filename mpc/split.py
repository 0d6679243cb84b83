"""What the bounds on the pinions leave to the follower torque, and its split by least effort, stage by stage.

These are the allocator's closed forms (`allocation.Bounds`, `allocation.least_effort`) as expressions, with the inverse
of the drive before them.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from allocation import Bounds
from mpc.drive import DriveInverse, clip

Array = NDArray[np.float64]


MACHINE = 12
"""Numbers of a machine."""


def machine(bounds: Bounds, drive: DriveInverse, preload_step: float = np.inf) -> Array:
    """(12,) numbers of gears, bounds and drive that the functions below ask for.

    The last one is by how much lambda may change from sample to sample [N m per tooth].
    """
    inertia = bounds.rotor_inertia * bounds.gears.pre_reduction**2
    own = [bounds.min_torque, bounds.max_torque, *(inertia * bounds.gears.mesh_ratios), float(bounds.friction[0])]
    teeth = [bounds.gears.follower_teeth, *bounds.gears.pinion_teeth]
    return np.array([*own, *teeth, drive.half_width, drive.back_emf, drive.limit, preload_step], dtype=np.float64)


class _Pair:
    """The two drives in symbols; torques are magnitudes in the sense that each must keep, as in `Bounds`."""

    def __init__(self, numbers: Any, acceleration: Any) -> None:
        self.least, self.most, rotor_1, rotor_2, rubbed, *others = ca.vertsplit(numbers)
        follower, teeth_1, teeth_2, *drive, self.step = others
        self.ratios, self.teeth = (follower / teeth_1, follower / teeth_2), (teeth_1, teeth_2)
        # what friction, whose sense is not sure near rest, and the rotor take of each
        self.taken = (rubbed - rotor_1 * acceleration, rubbed + rotor_2 * acceleration)
        self.low = [ca.fmin(self.least + ca.fmax(taken, 0), self.most) for taken in self.taken]
        self.drive = DriveInverse(half_width=drive[0], back_emf=drive[1], limit=drive[2])

    @property
    def reach(self) -> tuple[Any, Any]:
        """Least and greatest follower torque."""
        (n1, n2), (low_1, low_2) = self.ratios, self.low
        return n2 * low_2 - n1 * self.most, n2 * self.most - n1 * low_1

    def magnitudes(self, torque: Any, before: Any) -> tuple[Any, list[Any]]:
        """Of least effort: the particular solution of equation (3) plus the best admitted preload, which comes first.

        It leaves the one before only as fast as it may, unless the bounds ask for more.
        """
        torque = clip(torque, *self.reach)
        n1, n2 = self.ratios
        particular = [-n1 * torque / (n1**2 + n2**2), n2 * torque / (n1**2 + n2**2)]
        pairs = list(zip(particular, self.teeth, strict=True))
        lowest = ca.fmax(*((low - p) / N for low, (p, N) in zip(self.low, pairs, strict=True)))
        highest = ca.fmin(*((self.most - p) / N for p, N in pairs))
        vertex = -sum(p * N for p, N in pairs) / sum(N**2 for N in self.teeth)
        preload = clip(clip(vertex, lowest, highest), before - self.step, before + self.step)
        preload = clip(preload, lowest, ca.fmax(lowest, highest))
        return preload, [clip(p + preload * N, self.least, self.most) for p, N in pairs]


@cache
def reach() -> Any:
    """(velocity, acceleration, machine) -> least and greatest torque behind the drive (2,) [N m]."""
    velocity, acceleration, numbers = ca.SX.sym("velocity"), ca.SX.sym("acceleration"), ca.SX.sym("machine", MACHINE)
    pair = _Pair(numbers, acceleration)
    ends = ca.vertcat(*(pair.drive.effective(torque, velocity) for torque in pair.reach))
    return ca.Function("reach", [velocity, acceleration, numbers], [ends], {"cse": True})


@cache
def split() -> Any:
    """The pinion torques of a stage, as a `casadi.Function`.

    (lambda before [N m per tooth], torque behind the drive [N m], velocity, acceleration, machine) -> lambda, pinion
    torques (2,), what they put out behind the drive, and the least flank torque above the minimum, seen from the
    pinion [N m].
    """
    wanted, velocity, acceleration = ca.SX.sym("wanted"), ca.SX.sym("velocity"), ca.SX.sym("acceleration")
    before, numbers = ca.SX.sym("before"), ca.SX.sym("machine", MACHINE)
    pair = _Pair(numbers, acceleration)
    preload, (first, second) = pair.magnitudes(pair.drive.command(wanted, velocity), before)
    follower = pair.ratios[1] * second - pair.ratios[0] * first
    flanks = [xi - ca.fmax(taken, 0) for xi, taken in zip((first, second), pair.taken, strict=True)]
    outputs = [
        preload,
        ca.vertcat(first, -second),
        pair.drive.effective(follower, velocity),
        ca.fmin(*flanks) - pair.least,
    ]
    return ca.Function("split", [before, wanted, velocity, acceleration, numbers], outputs, {"cse": True})
