"""A log for an inverse model: its motion is given, and its torque is predicted from it.

In a tight loop the torque follows the motion. A disturbance then hardly moves the load, but the drive answers it with a
torque. So the motion is known, and the errors are those of the torque: the usual way to identify a robot (Gautier 1997;
Janot, Vandanjon and Gautier 2014). All signals pass the same zero-phase low pass and are sampled as often as that
needs. At rest dry friction balances any torque below the breakaway; these samples are masked.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.errors import Unidentifiable
from identification.inverse import filtered_motion, inverse_cutoff, smooth
from identification.log import Log
from identification.run import Run

_PER_PERIOD = 2.5  # samples in a period of the cutoff frequency: above it the low pass leaves little
_MOVING = 0.99  # of a low-passed mask: a sample with hardly any rest around it
_FEWEST = 50  # samples of a run
_ROUNDING = 1e-6  # of a number of samples


def inverse_log(log: Log) -> Log:
    """The log with the torque as the response.

    Raises:
        Unidentifiable: only the velocity was measured, the command is the set-point of a position servo, the torque
            never changes, or the load is at rest in nearly all samples.
    """
    if log.response == "velocity":
        raise Unidentifiable(
            "An inverse model needs the angle, and this log has the velocity alone; log the angle too."
        )
    if any(run.positioned for run in log.runs):
        raise Unidentifiable(
            "The command of this log is the set-point of a position servo, so no torque can be predicted from the "
            "motion; give the torque or the current of the drive."
        )
    if np.ptp(np.concatenate([run.command for run in log.runs])) == 0.0:
        raise Unidentifiable("The torque of this log never changes, so it does not show what the motion takes.")
    highest = inverse_cutoff(log)
    runs = tuple(found for run in log.runs if (found := _inverse_run(run, highest)) is not None)
    if not runs:
        raise Unidentifiable(
            "The load is at rest in nearly all samples, so no torque can be predicted from its motion."
        )
    decimation = round(runs[0].sample_time / log.runs[0].sample_time)
    return replace(log, runs=runs, colour=(), unsettled=False, decimation=decimation)


def cutoff_of(sample_time: float) -> float:
    """Cutoff of the low pass [Hz] behind an inverse log with that sample time [s]."""
    return 1.0 / (_PER_PERIOD * sample_time)


def _inverse_run(run: Run, highest: float) -> Run | None:
    """A run behind a low pass of at most a cutoff [Hz]; None if it hardly moves."""
    dt = run.duration / (len(run) - 1)
    step = int(np.ceil(1.0 / (_PER_PERIOD * highest * dt) - _ROUNDING))
    cutoff = cutoff_of(step * dt)
    motion = filtered_motion(run, cutoff)
    edge = max(1, min(motion.time.size // 10, round(2.0 / (cutoff * dt))))  # where the low pass is not valid
    every = slice(edge, motion.time.size - edge, step)
    moving = ~motion.still & (np.interp(motion.time, run.time, run.valid.astype(float)) == 1.0)
    valid = smooth(moving.astype(float), cutoff, dt)[every] > _MOVING
    if valid.sum() < _FEWEST:
        return None
    direction = np.clip(smooth(np.where(motion.still, 0.0, np.sign(motion.velocity)), cutoff, dt), -1.0, 1.0)
    time = motion.time[every]
    return Run(
        label=run.label,
        number=run.number,
        time=time,
        command=motion.torque[every],
        output=motion.angle[every],
        valid=valid,
        servo_gain=np.zeros(time.size),
        response="torque",
        velocity=motion.velocity[every],
        acceleration=motion.acceleration[every],
        direction=direction[every],
        own=run.own,
        zero=run.zero,
        run=run.run,
        start=run.start,
    )
