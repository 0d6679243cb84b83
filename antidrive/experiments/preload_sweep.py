"""A sweep of the preload at standstill, simulated on many machines at once; the result is a log as of a real drive.

The preload rises and falls linearly between two levels, in alternating directions. Meanwhile a loop over the motors'
encoders holds the load, or lets it move slowly; it does not know the backlash.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antidrive.remaining_time import Parts
from identification.log import Log
from identification.run import Run
from plant.fleet import Fleet

Array = NDArray[np.float64]

_FORGETS = 0.8  # forgetting factor per sample of the loop's speed filter


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Time course of the preload.

    Attributes:
        least, greatest: preload of each drive, at the load side [N m].
        visit: duration in one direction [s].
        visits: their number; the direction alternates.
        sample_time: [s].
        stiffness, damping: of the loop [N m/rad], [N m s/rad].
    """

    least: float
    greatest: float
    visit: float
    visits: int
    sample_time: float
    stiffness: float
    damping: float

    def preload(self) -> Array:
        """(T,) preload of each drive [N m], at the load side."""
        samples = round(self.visit / self.sample_time)
        rise = 1.0 - np.abs(2.0 * np.arange(samples) / samples - 1.0)
        one = self.least + (self.greatest - self.least) * rise
        return np.concatenate([one if number % 2 == 0 else -one for number in range(self.visits)])


def logs_of(fleet: Fleet, sweep: Sweep, *, load_speed: ArrayLike, seed: int, parts: Parts | None = None) -> list[Log]:
    """One log per machine, with the channels of a real drive; the loads move at (B,) [rad/s]."""
    rig, preload, dt = fleet.rigs[0], sweep.preload(), sweep.sample_time
    count, drives = len(fleet), len(rig.drives)
    rng = np.random.default_rng(seed)
    wanted_rate = np.broadcast_to(np.asarray(load_speed, dtype=np.float64), (count,))
    reading, motors, pinions = (np.empty((preload.size, count, *more)) for more in ((), (drives,), (drives,)))

    def allocated(torque: Array, preload: float) -> Array:
        return rig.gears.pinion_torques(
            torque, np.full(count, preload / (rig.gears.mesh_ratios * rig.gears.null_vector)[0])
        )

    state = fleet.rest(torques=allocated(np.zeros(count), preload[0]))
    start = before = np.mean(fleet.motor_angles(state) / -rig.motor_ratios, axis=1)
    rate = np.zeros(count)
    for k, size in enumerate(preload):
        reading[k] = fleet.measure(state, rng.standard_normal(count))
        motors[k] = fleet.motor_angles(state, rng.standard_normal((count, drives)))
        held = np.mean(motors[k] / -rig.motor_ratios, axis=1)
        rate, before = _FORGETS * rate + (1.0 - _FORGETS) * (held - before) / dt, held
        off = start + wanted_rate * (k * dt) - held
        pinions[k] = allocated(sweep.stiffness * off + sweep.damping * (wanted_rate - rate), size)
        state = fleet.advance(state, pinions[k], dt)
        if parts is not None:
            parts.done()
    time = np.arange(preload.size, dtype=np.float64) * dt
    return [_log(fleet, time, reading[:, b], motors[:, b], pinions[:, b]) for b in range(count)]


def _log(fleet: Fleet, time: Array, reading: Array, motors: Array, pinions: Array) -> Log:
    run = Run(
        label="preload sweep",
        number=0,
        time=time,
        command=fleet.rigs[0].gears.output_torque(pinions),
        output=reading,
        valid=np.ones(time.size, dtype=bool),
        servo_gain=np.zeros(time.size),
        drive_angles=motors,
        torques=pinions,
    )
    return Log(runs=(run,), axis="rotary")
