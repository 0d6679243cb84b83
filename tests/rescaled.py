"""The same experiment in other units of torque, angle and time, and in what two diagnoses of it differ."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

from diagnosis import Diagnosis
from identification.fit_result import Fit, FittedParameter
from identification.log import Log

_IN_ITS_VARIABLE = ("low", "high", "rate")  # of what has no name, which states no unit: its heights are compared


@dataclass(frozen=True, kw_only=True)
class Units:
    """Factors of all numbers of a log; the angle of a rotary axis is in radians, as cos x is to say."""

    torque: float = 1.0
    angle: float = 1.0
    time: float = 1.0

    def log(self, log: Log) -> Log:
        """The log in these units."""
        torque, angle, time = self.torque, self.angle, self.time
        runs = (
            replace(
                run,
                time=time * run.time,
                start=time * run.start,
                command=torque * run.command,
                output=angle * run.output,
                velocity=None if run.velocity is None else angle / time * run.velocity,
                servo_gain=torque / angle * run.servo_gain,
                servo_damping=torque * time / angle * run.servo_damping,
                command_limit=torque * run.command_limit,
            )
            for run in log.runs
        )
        return replace(log, runs=tuple(runs))

    def factor(self, unit: str) -> float:
        """What a number of a unit such as "N m s/rad" or "N s^2/m" is multiplied by."""
        inertia = self.torque * self.time**2 / self.angle
        sizes = {"N": self.torque, "m": self.angle, "s": self.time, "Hz": 1.0 / self.time, "kg": inertia}
        found, (above, *below) = 1.0, unit.split("/")
        for sign, part in ((1, above), *((-1, part) for part in below)):
            for name, power in re.findall(r"([a-zA-Z]+)(?:\^(\d))?", part):
                found *= sizes.get(name, 1.0) ** (sign * int(power or 1))
        return found


def fit_differences(one: Fit, other: Fit, units: Units) -> Iterator[tuple[str, float]]:
    """By name, how far the values of a fit are from those of another in other units, of the value or standard error."""
    if one.model.names != other.model.names:
        yield f"{', '.join(one.model.names)} or {', '.join(other.model.names)}", float("inf")
        return
    for a, b in zip(one.parameters, other.parameters, strict=True):
        if a.name.split(".")[-1] not in _IN_ITS_VARIABLE:
            yield a.name, _apart(a, b, units)


def _apart(a: FittedParameter, b: FittedParameter, units: Units) -> float:
    if a.value is None or b.value is None:
        return 0.0 if a.value is b.value else float("inf")
    return abs(b.value / units.factor(a.unit) - a.value) / (max(abs(a.value), a.std or 0.0) or 1.0)


def differences(one: Diagnosis, other: Diagnosis, units: Units) -> Iterator[tuple[str, float]]:
    """The same of two diagnoses; of what is said and not counted, infinity where it differs."""
    lines = [
        (d.verdict, [c.effect for c in d.causes], [m.effect for m in d.minor], d.unexplained.depends_on)
        for d in (one, other)
    ]
    if lines[0] != lines[1]:
        yield f"{lines[0]} or {lines[1]}", float("inf")
        return
    for a, b in zip(one.causes, other.causes, strict=True):
        yield f"probability of {a.effect}", abs(b.probability - a.probability)
        yield f"torque of {a.effect}", abs(b.rms / units.torque - a.rms) / (a.rms or 1.0)
    for small, same in zip(one.minor, other.minor, strict=True):
        yield f"probability of {small.effect}", abs(same.probability - small.probability)
    sizes = ((d.unknown.probability, d.unknown.share) for d in (one, other))
    for unknown, rescaled in zip(*sizes, strict=True):
        yield "unmodelled torque", 0.0 if unknown == rescaled else abs((unknown or 0.0) - (rescaled or 0.0))
    yield "gain", abs(one.gain.cut - other.gain.cut)
    yield "what is unexplained", abs(one.unexplained.share - other.unexplained.share)
    yield "residual torque", abs(one.residual_after.excess - other.residual_after.excess)
    yield from fit_differences(one.base, other.base, units)
    yield from fit_differences(one.extended, other.extended, units)
