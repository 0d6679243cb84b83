"""The same experiment in other units of torque, angle and time."""

from __future__ import annotations

from dataclasses import replace

from identification.fit_result import Fit
from identification.log import Log


def rescaled(log: Log, *, torque: float = 1.0, angle: float = 1.0, time: float = 1.0) -> Log:
    """The log with its numbers times these factors; the angle of a rotary axis is in radians, as cos x is to say."""
    runs = tuple(
        replace(
            run,
            time=time * run.time,
            command=torque * run.command,
            output=angle * run.output,
            servo_gain=torque / angle * run.servo_gain,
            command_limit=torque * run.command_limit,
        )
        for run in log.runs
    )
    return replace(log, runs=runs)


def apart(one: Fit, other: Fit, *, torque: float = 1.0, angle: float = 1.0, time: float = 1.0) -> float:
    """Largest difference of the values of a fit and of one in other units, of the value or its standard error."""
    factors = {
        "inertia": torque * time**2 / angle,
        "gravity": torque,
        "viscous_friction": torque * time / angle,
        "dead_zone.half_width": torque,
    }
    worst = 0.0
    for a, b in zip(one.parameters, other.parameters, strict=True):
        if (a.value is None) != (b.value is None):
            return float("inf")
        if a.value is not None and b.value is not None:
            size = max(abs(a.value), a.std or 0.0) or 1.0
            worst = max(worst, abs(b.value / factors[a.name] - a.value) / size)
    return worst
