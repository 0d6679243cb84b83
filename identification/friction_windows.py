"""Windows of a log over which the momentum balance is exact, whatever the motion inside a window."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from identification.log import Log, Run
from plant.effects.effect import Array

_WINDOWS = 400  # per log, if each then has enough samples
_SAMPLES = 8  # least number in a window
_SLOWEST = 3.0  # standard errors of the velocity: below it the direction is unknown, or the acceleration is constant


def friction_windows(log: Log) -> dict[str, Array]:
    """Means over windows with constant acceleration, in which the load moves in the direction of both neighbours."""
    samples = max(_SAMPLES, sum(map(len, log.runs)) // _WINDOWS)
    names = ("torque", "velocity", "velocity_error", "acceleration", "change", "trend", "cos", "sin")
    parts = []
    for run in log.runs:
        found = np.array(list(_windows_of(run, samples))).reshape(-1, len(names))
        rows = dict(zip(names, found.T, strict=True))
        way = np.sign(rows["velocity"]) * (np.abs(rows["velocity"]) > _SLOWEST * rows["velocity_error"])
        before, after = np.concatenate((way[:1], way[:-1])), np.concatenate((way[1:], way[-1:]))
        even = np.abs(rows["trend"]) <= _SLOWEST * np.sqrt(2.0) * rows["velocity_error"]
        parts.append(kept_of(rows, even & (way != 0.0) & (way == before) & (way == after)))
    return {name: np.concatenate([part[name] for part in parts]) for name in names}


def kept_of(rows: dict[str, Array], kept: NDArray[np.bool_]) -> dict[str, Array]:
    """The selected windows of each column."""
    return {name: values[kept] for name, values in rows.items()}


def _windows_of(run: Run, samples: int) -> Iterable[tuple[float, ...]]:
    """For each window torque, velocity, its error, acceleration, change and trend of the velocity, cos and sin x."""
    held = np.diff(run.time, append=run.time[-1] + run.sample_time)
    after = np.append(run.output[1:], run.output[-1])
    middle, rate = 0.5 * (run.output + after), (after - run.output) / held
    torque = run.command - run.servo_gain * middle - run.servo_damping * rate  # mean over the hold time of the command
    torque = np.clip(torque, -run.command_limit, run.command_limit)
    near = samples // 2
    for first in range(near, len(run) - samples - near, samples):
        last, part = first + samples, slice(first, first + samples)
        if not run.valid[first - near : last + near].all():
            continue
        time = run.time[part]
        length = run.time[last] - run.time[first]
        velocity = (run.output[last] - run.output[first]) / length
        line = np.polyfit(time - time.mean(), run.output[part], 2)
        off = run.output[part] - np.polyval(line, time - time.mean())
        edges = [
            (run.output[at + near] - run.output[at - near]) / (run.time[at + near] - run.time[at - near])
            for at in (first, last)
        ]
        weights = held[part] / length
        yield (
            float(torque[part] @ weights),
            velocity,
            float(np.sqrt(2.0) * off.std() / length),
            (edges[1] - edges[0]) / length,
            edges[1] - edges[0],
            0.5 * (edges[1] + edges[0]) - velocity,
            float(np.cos(run.output[part]) @ weights),
            float(np.sin(run.output[part]) @ weights),
        )
