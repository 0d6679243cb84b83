"""Range of the output torque within the bounds of the pinions, and its least-effort allocation, stage by stage.

These are the closed forms of the allocator (`allocation.Bounds`, `allocation.least_effort`) as expressions, combined
with the inverse of the drive.
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


_OF_A_DRIVE = ("most", "least", "ratio", "null", "direction", "rotor", "rubbed")
_OF_BOTH = ("half_width", "back_emf", "limit", "preload_step")

MACHINE = 2 * len(_OF_A_DRIVE) + len(_OF_BOTH)
"""Number of machine parameters: each drive parameter for drives 1 and 2, then the common ones."""


def machine(bounds: Bounds, drive: DriveInverse, preload_step: float = np.inf) -> Array:
    """(MACHINE,) parameters of drive train, bounds and drive for the functions below.

    A single drive has no preload. It is treated as a pair, one part for each direction, without a minimum torque; least
    effort leaves one part at zero. Its torque is the sum of both.

    Args:
        bounds: of one or two drives.
        drive: inverse of the drive, from output torque to command.
        preload_step: greatest change of lambda from sample to sample.
    """
    gears, alone = bounds.gears, bounds.gears.drives == 1
    inertia = np.zeros(2) if alone else bounds.structure.reductions**2 * bounds.rotor_inertias
    numbers = {
        "least": 0.0 if alone else bounds.least,
        "most": bounds.greatest,
        "ratio": gears.mesh_ratios,
        "null": 1.0 if alone else np.abs(gears.null_vector),
        "direction": np.array((-1, 1)) * gears.directions[0] if alone else np.array(gears.directions),
        "rotor": inertia * gears.mesh_ratios,
        "rubbed": 0.0 if alone else bounds.friction,
    }
    both = np.column_stack([np.broadcast_to(numbers[name], 2) for name in _OF_A_DRIVE])
    own = [drive.half_width, drive.back_emf, drive.limit, preload_step]
    return np.concatenate((both.T.ravel(), own)).astype(np.float64)


class _Pair:
    """The two drives as symbols; torques are magnitudes in the required directions, as in `Limits`."""

    def __init__(self, numbers: Any, acceleration: Any) -> None:
        each = {name: (numbers[2 * i], numbers[2 * i + 1]) for i, name in enumerate(_OF_A_DRIVE)}
        *drive, self.step = ca.vertsplit(numbers[2 * len(_OF_A_DRIVE) :])
        self.least, self.most, self.ratios, self.teeth = (each[name] for name in ("least", "most", "ratio", "null"))
        self.directions, (rotor_1, rotor_2), rubbed = each["direction"], each["rotor"], each["rubbed"]
        # torque lost to friction (worst case, its direction is uncertain near rest) and to the rotor of each drive
        self.taken = (rubbed[0] - rotor_1 * acceleration, rubbed[1] + rotor_2 * acceleration)
        ends = zip(self.least, self.most, self.taken, strict=True)
        self.low = [ca.fmin(least + ca.fmax(taken, 0), most) for least, most, taken in ends]
        self.drive = DriveInverse(half_width=drive[0], back_emf=drive[1], limit=drive[2])

    @property
    def reach(self) -> tuple[Any, Any]:
        """Minimum and maximum output torque."""
        (n1, n2), (low_1, low_2) = self.ratios, self.low
        return n2 * low_2 - n1 * self.most[0], n2 * self.most[1] - n1 * low_1

    def magnitudes(self, torque: Any, before: Any) -> tuple[Any, list[Any]]:
        """Least effort: preload, and magnitudes as the particular solution of equation (3) plus the best preload.

        The preload changes from the previous one at most by its rate limit, unless the bounds require more.
        """
        torque = clip(torque, *self.reach)
        n1, n2 = self.ratios
        particular = [-n1 * torque / (n1**2 + n2**2), n2 * torque / (n1**2 + n2**2)]
        pairs = list(zip(particular, self.teeth, strict=True))
        lowest = ca.fmax(*((low - p) / N for low, (p, N) in zip(self.low, pairs, strict=True)))
        highest = ca.fmin(*((most - p) / N for most, (p, N) in zip(self.most, pairs, strict=True)))
        vertex = -sum(p * N for p, N in pairs) / sum(N**2 for N in self.teeth)
        preload = clip(clip(vertex, lowest, highest), before - self.step, before + self.step)
        preload = clip(preload, lowest, ca.fmax(lowest, highest))
        boxes = zip(pairs, self.least, self.most, strict=True)
        return preload, [clip(p + preload * N, least, most) for (p, N), least, most in boxes]


@cache
def reach() -> Any:
    """(velocity, acceleration, machine) -> least and greatest drive output torque (2,) [N m]."""
    velocity, acceleration, numbers = ca.SX.sym("velocity"), ca.SX.sym("acceleration"), ca.SX.sym("machine", MACHINE)
    pair = _Pair(numbers, acceleration)
    ends = ca.vertcat(*(pair.drive.effective(torque, velocity) for torque in pair.reach))
    return ca.Function("reach", [velocity, acceleration, numbers], [ends], {"cse": True})


@cache
def allocation() -> Any:
    """The pinion torques of a stage, as a `casadi.Function`.

    (lambda before, wanted drive output torque [N m], velocity, acceleration, machine) -> lambda, pinion torques (2,),
    actual drive output torque, and the smallest contact torque minus the minimum, seen from the pinion [N m].
    """
    wanted, velocity, acceleration = ca.SX.sym("wanted"), ca.SX.sym("velocity"), ca.SX.sym("acceleration")
    before, numbers = ca.SX.sym("before"), ca.SX.sym("machine", MACHINE)
    pair = _Pair(numbers, acceleration)
    preload, (first, second) = pair.magnitudes(pair.drive.command(wanted, velocity), before)
    output_torque = pair.ratios[1] * second - pair.ratios[0] * first
    flanks = [
        xi - ca.fmax(taken, 0) - least for xi, taken, least in zip((first, second), pair.taken, pair.least, strict=True)
    ]
    outputs = [
        preload,
        ca.vertcat(pair.directions[0] * first, pair.directions[1] * second),
        pair.drive.effective(output_torque, velocity),
        ca.fmin(*flanks),
    ]
    return ca.Function("allocation", [before, wanted, velocity, acceleration, numbers], outputs, {"cse": True})
