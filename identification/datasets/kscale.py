"""K-Scale servo bench: Feetech STS3215 position servos (12 V) that move a known mass on an arm.

K-Scale Labs, sysid repository, 2025: masses of 0.5 to 1.2 kg at 100 or 150 mm, six firmware gains, five trajectories,
repeated. The authors measured the firmware's law: duty = kp * 0.16489 / rad * (set-point - angle). Its set-point is
not the commanded one: the firmware limits its rate to about 5 rad/s at any gain (`setpoint_rate_limit`; the data show
the same ramp at all gains, the published law does not include it).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from identification.datasets.dataset import Dataset, arrays_of, source
from identification.datasets.pendulum import ENDS_WHEN_OFF, VOLTS_UNKNOWN_SCALE, pendulum_run
from identification.errors import MalformedLog
from identification.log import Log
from identification.recording import Recording
from plant.servo import ServoModel

_DUTY_PER_RAD = 0.16489  # for each unit of the firmware's gain
_ARRAYS = ("mass", "length", "kp", "trajectory", "rep", "timestamp", "goal_position", "position", "input_volts")


def read(files: list[Path], *, select: Mapping[str, float] | None = None) -> Dataset:
    """Read the runs of one mass and length: repetition 0 is fitted, the others are held out.

    Args:
        files: NPZ files.
        select: "mass" [kg], "length" [m] and "kp" of the runs; by default the mass and length with the most runs
            (among equals the lightest mass, then the shortest arm), all gains.
    """
    estimation: list[Recording] = []
    held_out: list[Recording] = []
    sources = []
    wanted = dict(select or {})
    for file in files:
        data = arrays_of(file, (*_ARRAYS, "torque_enable"))
        sources.append(source(file))
        pairs = list(zip(data["mass"].tolist(), data["length"].tolist(), strict=True))
        counts = Counter(pairs)
        mass, length = min(counts, key=lambda pair: (-counts[pair], pair))
        wanted = {"mass": mass, "length": length} | wanted
        for row in range(len(pairs)):
            if any(not np.isclose(float(data[name][row]), value) for name, value in wanted.items()):
                continue
            run = pendulum_run(
                label=f"{data['trajectory'][row]} kp {data['kp'][row]} rep {data['rep'][row]}",
                number=row,
                time=data["timestamp"][row].astype(float),
                setpoint=data["goal_position"][row].astype(float),
                position=data["position"][row].astype(float),
                duty_per_rad=_DUTY_PER_RAD * float(data["kp"][row]),
                volts=data["input_volts"][row].astype(float),
                enabled=data["torque_enable"][row] > 0.5,
            )
            (estimation if data["rep"][row] == 0 else held_out).append(run)
    if not estimation:
        raise MalformedLog(f"No run of the data set has {wanted}; choose a mass and a length that it holds.")
    chosen = f"mass {wanted['mass']:.3f} kg, arm {wanted['length']:.3f} m"
    notes = (
        f"K-Scale servo bench (K-Scale Labs 2025), {chosen}: repetition 0 is fitted, the others are held out.",
        "One servo model has one inertia, so runs with other masses and arms are left out.",
        VOLTS_UNKNOWN_SCALE,
        ENDS_WHEN_OFF,
        "Published mean absolute errors with friction models M1 to M6, on the data they were fitted to: 0.0309 to "
        "0.0323 rad.",
    )
    logs = [
        Log.from_recordings(runs, axis="rotary", sources=sources, command_unit="V") if runs else None
        for runs in (estimation, held_out)
    ]
    first = logs[0]
    if first is None:
        raise MalformedLog("The data set holds no run that can be used.")
    base = ServoModel(inertia=0.02, gravity=1.0, viscous_friction=0.5)
    return Dataset(estimation=first, holdout=logs[1], base=base, notes=notes)
