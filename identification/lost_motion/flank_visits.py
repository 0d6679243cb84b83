"""Samples in which two opposed drives are in contact and slide, so that friction has a known direction.

While the preload is swept through both signs, each drive visits one flank, then the other. It transmits its torque less
friction. The direction of friction is that of the rotor's motion; this is measured at the motor, because its encoder is
finer than the load's by the gear ratio. Samples in which a rotor may stand still are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identification.checks.faults import quantum
from identification.errors import MalformedLog
from identification.run import Run
from plant.drive_train import DriveTrain

Array = NDArray[np.float64]

_SETTLED = 0.25  # share of a visit after which the contact no longer bounces
_COUNTS = 3.0  # encoder counts by which a rotor must move before and after a sample to count as moving


@dataclass(frozen=True, kw_only=True, eq=False)
class FlankSamples:
    """N samples on known flanks; all torques and angles are referred to the load.

    Attributes:
        visit: (N,) number of the sample's visit of a flank.
        flank: (N, 2) flank on which each drive is in contact, +1 or -1: the sign of its torque.
        loading: (N, 2) whether friction lowers the magnitude of the transmitted torque; otherwise it raises it.
        torque: (N, 2) of each drive [N m].
        rotors: (N, 2) angle of each rotor [rad].
        measured: (N,) angle measured by the load's encoder [rad].
    """

    visit: NDArray[np.int64]
    flank: Array
    loading: NDArray[np.bool_]
    torque: Array
    rotors: Array
    measured: Array


def flank_samples(run: Run, gears: DriveTrain) -> FlankSamples:
    """The samples of a run that can be used for lost motion; possibly none.

    Raises `MalformedLog` when the run has no pinion torques or no motor angles.
    """
    if run.torques is None or run.drive_angles is None:
        raise MalformedLog(f"{run.label}: lost motion needs torque_1, torque_2, angle_1, angle_2 beside the angle.")
    commanded = run.torques * gears.torque_map
    torque = 0.5 * (
        commanded + np.vstack((commanded[:1], commanded[:-1]))
    )  # a torque held in steps acts as a ramp half a step later
    rotors = run.drive_angles / (gears.pre_reductions * gears.angle_map)
    visit = _visits(np.where(np.prod(commanded, axis=1) < 0.0, np.sign(commanded[:, 1]), 0.0))
    motion = np.column_stack([_motion(column) for column in rotors.T])
    use = run.valid & (visit >= 0) & np.all(motion != 0.0, axis=1)
    flank = np.sign(torque[use])
    return FlankSamples(
        visit=visit[use],
        flank=flank,
        loading=flank == motion[use],
        torque=torque[use],
        rotors=rotors[use],
        measured=run.output[use],
    )


def _visits(direction: Array) -> NDArray[np.int64]:
    """(T,) number of the visit, -1 outside and during settling; short stretches are bounces at a reversal."""
    edges = np.concatenate(([0], np.flatnonzero(np.diff(direction)) + 1, [direction.size]))
    stretches = [(first, last) for first, last in pairwise(edges) if direction[first] != 0.0]
    longest = max((last - first for first, last in stretches), default=0)
    visit = np.full(direction.size, -1)
    for number, (first, last) in enumerate(stretches):
        if last - first > longest // 2:
            visit[first + int(np.ceil(_SETTLED * (last - first))) : last] = number
    return visit


def _motion(rotor: Array) -> Array:
    """(T,) direction in which a rotor (T,) clearly moves before and after a sample; 0 where it may stand still."""
    found = np.zeros(rotor.size)
    shake = 2.0 * float(np.median(np.abs(np.diff(rotor, 2)))) if rotor.size > 2 else 0.0
    resolution = max(quantum(rotor), shake)
    stride = max(rotor.size // 200, 1)
    speed = float(np.median(np.abs(rotor[stride:] - rotor[:-stride]))) / stride if rotor.size > stride else 0.0
    reach = max(int(np.ceil(2.0 * _COUNTS * resolution / speed)), 2) if speed > 0.0 else rotor.size
    if 2 * reach >= rotor.size:
        return found
    before, after = rotor[reach:-reach] - rotor[: -2 * reach], rotor[2 * reach :] - rotor[reach:-reach]
    clear = np.minimum(np.abs(before), np.abs(after)) > _COUNTS * resolution
    found[reach:-reach] = np.where(clear & (before * after > 0.0), np.sign(before), 0.0)
    return found
