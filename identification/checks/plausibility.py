"""Units that do not fit together. A unit is never changed: the message names the option that corrects it."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from identification.errors import MalformedLog
from identification.recording import Finding, Recording

_TURN = 2.0 * np.pi
SLOWEST_SAMPLING = 0.5  # [s]
FASTEST_SAMPLING = 1e-6  # [s]

# Size of each unit that a channel may have beside that in which it was read.
_OUTPUTS = {
    "rotary": {"angle=deg": np.pi / 180.0, "angle=turn": _TURN, "angle=mrad": 1e-3},
    "linear": {"position=mm": 1e-3, "position=um": 1e-6},
}
_VELOCITIES = {
    "rotary": {"velocity=deg/s": np.pi / 180.0, "velocity=rpm": _TURN / 60.0, "velocity=turn/s": _TURN},
    "linear": {"velocity=mm/s": 1e-3, "velocity=mm/min": 1e-3 / 60.0},
}
_TIMES = {"time=ms": 1e-3, "time=us": 1e-6}
_NEAR = 0.02  # of a factor; two of them differ by 4.5 % at least (1/60 from turns in rpm, pi/180 from deg/s)


def check_time_unit(recording: Recording) -> None:
    """Raise an error for a sample time that no servo log has: milliseconds or microseconds taken as seconds."""
    if len(recording) < 2:
        return
    step = float(np.median(np.diff(recording.time)))
    if step > SLOWEST_SAMPLING:
        name, unit = recording.name("time"), "ms" if step <= 500 else "us"
        hint = (
            "record it faster"
            if "time" in recording.stated
            else f"if '{name}' is not in seconds, give its unit, for example --unit time={unit}"
        )
        raise MalformedLog(f"{recording.label}: a sample time of {step:.3g} s is too slow to identify a servo; {hint}.")
    if step < FASTEST_SAMPLING:
        example = ", for example --unit time=s" if "time" in recording.stated else " with --unit time=UNIT"
        raise MalformedLog(
            f"{recording.label}: a sample time of {step:.3g} s is faster than any servo log, "
            f"give the unit of the time{example}."
        )


def velocity_ratio(recording: Recording) -> float | None:
    """Slope of the output's increments over the integral of the velocity channel; None if they do not correlate."""
    velocity = recording.others.get("velocity")
    if velocity is None or np.ptp(velocity) == 0:
        return None
    path = np.append(0.0, np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(recording.time)))
    window = max(1, len(path) // 50)
    sound = recording.valid[window:] & recording.valid[:-window]
    driven = (path[window:] - path[:-window])[sound]
    moved = (recording.output[window:] - recording.output[:-window])[sound]
    size = float(driven @ driven) * float(moved @ moved)
    if size <= 0 or abs(float(driven @ moved)) < 0.9 * np.sqrt(size):
        return None
    return float(driven @ moved) / float(driven @ driven)


def check_velocity_unit(recording: Recording) -> tuple[Recording, list[Finding]]:
    """Raise an error if velocity and output differ by the factor of a unit; drop a velocity with another ratio."""
    ratio = velocity_ratio(recording)
    if ratio is None:
        return recording, []
    output, velocity = recording.name("output"), recording.name("velocity")
    with_rate = ""
    if ratio > 0.0 and "rate" in recording.stated:
        with_rate = f"--rate {1.0 / (ratio * float(np.median(np.diff(recording.time)))):.4g}"
    if 0.8 < ratio < 1.25:
        if not with_rate or abs(np.log(ratio)) < _NEAR:
            return recording, []
        text = (
            f"{recording.label}: '{output}' moves {ratio:.4g} times as fast as '{velocity}' says; with {with_rate} "
            "they agree"
        )
        return recording, [Finding(kind="rate", repaired=False, text=text)]
    fitting = _units_for(recording, ratio)
    if fitting and fitting != ["--unit velocity=turn/s"]:  # that may be the ratio of a gear too
        raise MalformedLog(
            f"{recording.label}: '{output}' moves {ratio:.4g} times as fast as '{velocity}' says, which is the "
            f"factor of a unit: try {' or '.join(fitting)}, or give the right unit of one of them."
        )
    text = (
        f"{recording.label}: '{output}' moves {ratio:.4g} times as fast as '{velocity}' says, so the velocity is not "
        "used; give --scale velocity=FACTOR if it belongs to another shaft or has another sign"
    )
    if fitting:
        text += f", or {fitting[0]} if it is in turns"
    if with_rate:
        text += f", or {with_rate} if that is the sampling rate"
    others = {name: values for name, values in recording.others.items() if name != "velocity"}
    return replace(recording, others=others), [Finding(kind="velocity", repaired=True, text=text)]


def _units_for(recording: Recording, ratio: float) -> list[str]:
    """Options that make velocity and output agree, of as few channels as possible; none of a unit that was stated."""
    outputs, velocities, times = (
        {"": 1.0} | ({} if channel in recording.stated else {f"--unit {unit}": size for unit, size in units.items()})
        for channel, units in (
            ("output", _OUTPUTS[recording.axis]),
            ("velocity", _VELOCITIES[recording.axis]),
            ("time", _TIMES),
        )
    )
    fitting = [
        [option for option in options if option]
        for options in product(outputs, velocities, times)
        if ratio > 0.0 and abs(np.log(ratio * outputs[options[0]] / velocities[options[1]] / times[options[2]])) < _NEAR
    ]
    fewest = min(map(len, fitting), default=0)
    return [" ".join(options) for options in fitting if len(options) == fewest]
