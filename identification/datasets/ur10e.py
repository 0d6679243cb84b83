"""UR10e: one joint of a robot arm sweeps while the others are at rest.

Mamedov, Mikhel: Practical Aspects of Model-Based Collision Detection. Frontiers in Robotics and AI, 2020. One file per
joint, about 100 Hz with irregular steps; the motor current is used instead of the torque.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from identification.datasets.dataset import Dataset, arrays_of, recording, source
from identification.errors import MalformedLog
from identification.log import Log
from identification.run import Run
from plant.errors import BadParameter
from plant.servo import ServoModel

_SHARE = 0.5  # of the sweep that is fitted
_BRAKING = 0.2  # [s]
# Offset from a joint's measurement to the angle of the moving part above the horizon, with the other joints in their
# rest positions of these sweeps: eq. (4) has gravity alpha cos x. The axis of the first joint is vertical: no offset.
_ABOVE_HORIZON = {2: np.pi, 3: 0.5 * np.pi}


def read(files: list[Path], *, joint: int | None = None) -> Dataset:
    """Read the sweep of one joint (1, 2, 3); its second half is held out.

    The current `i` was measured; `tau_des` is computed by the robot's torque model, so a fit to it would identify the
    manufacturer's model and not the machine.
    """
    joints = {int(found.group(1)): file for file in files if (found := re.search(r"joint_(\d)\.npz$", file.name))}
    if not joints:
        raise MalformedLog("UR10e's sweeps are files whose names end in joint_K.npz; none is there.")
    chosen = min(joints) if joint is None else joint
    if chosen not in joints:
        raise BadParameter(f"--joint {chosen}: there is a sweep of joint {', '.join(map(str, sorted(joints)))} only.")
    file = joints[chosen]
    data = arrays_of(file, ("t", "q", "i"))
    run = recording(
        label=file.name,
        time=data["t"].ravel(),
        command=data["i"][:, chosen - 1].astype(float),
        output=data["q"][:, chosen - 1].astype(float) + _ABOVE_HORIZON.get(chosen, 0.0),
    )
    log = Log.from_recordings([run], axis="rotary", sources=[source(file)], command_unit="A")
    whole = max(log.runs, key=len)
    whole = whole.slice(0, _end_of_sweep(whole))
    cut = int(len(whole) * _SHARE)
    last = replace(whole.slice(cut, len(whole)), label=f"{whole.label}, second half")
    notes = (
        f"UR10e (Mamedov, Mikhel 2020), joint {chosen}: the first half of the sweep is fitted, the second is held out.",
        "The torque's scale is unknown: torques are in amperes at the motor, so J, alpha and K are per ampere.",
    )
    return Dataset(
        estimation=replace(log, runs=(whole.slice(0, cut),)),
        holdout=replace(log, runs=(last,)),
        base=ServoModel(inertia=1.0, gravity=0.0, viscous_friction=1.0),
        inverse=True,  # the current was measured in the tight loop of a robot
        notes=notes,
    )


def _end_of_sweep(run: Run) -> int:
    """Index of a sample shortly before the robot brakes to rest from full speed; the rest is not part of the sweep."""
    speed = np.abs(np.gradient(run.output, run.time))
    braked = run.time[np.flatnonzero(speed > 0.5 * np.quantile(speed, 0.99))[-1]]
    return int(np.searchsorted(run.time, braked - _BRAKING))
