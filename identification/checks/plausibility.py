"""Units that do not fit together. A unit is never changed: the message names the option that corrects it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.errors import MalformedLog
from identification.recording import Finding, Recording

_TURN = 2.0 * np.pi
SLOWEST_SAMPLING = 0.5  # [s]
FASTEST_SAMPLING = 1e-6  # [s]

# Ratio of the output's speed to the velocity channel, and the unit that explains it.
_RATIOS = {
    "rotary": (
        (180 / np.pi, "angle=deg"),
        (np.pi / 180, "velocity=deg/s"),
        (np.pi / 30, "velocity=rpm"),
        (1 / (2 * np.pi), "angle=turn"),
        (1e-3, "time=ms"),
        (1e-6, "time=us"),
        (1e3, "angle=mrad"),
    ),
    "linear": ((1e3, "position=mm"), (1e-3, "velocity=mm/s"), (1e-6, "time=us"), (1e6, "position=um")),
}


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
        raise MalformedLog(
            f"{recording.label}: a sample time of {step:.3g} s is faster than any servo log, "
            "give the unit of the time with --unit time=UNIT."
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
    if ratio is None or 0.8 < ratio < 1.25:
        return recording, []
    output, velocity = recording.name("output"), recording.name("velocity")
    for factor, option in _RATIOS[recording.axis]:
        if ratio > 0 and abs(np.log(ratio / factor)) < 0.1:
            raise MalformedLog(
                f"{recording.label}: '{output}' moves {ratio:.4g} times as fast as '{velocity}' says, which is the "
                f"factor of a unit: try --unit {option}, or give the right unit of one of them."
            )
    text = (
        f"{recording.label}: '{output}' moves {ratio:.4g} times as fast as '{velocity}' says, so the velocity is not "
        "used; give --scale velocity=FACTOR if it belongs to another shaft or has another sign"
    )
    if recording.axis == "rotary" and abs(ratio - _TURN) < 0.02 * _TURN:  # or the ratio of a gear
        text += ", or --unit velocity=turn/s if it is in turns"
    others = {name: values for name, values in recording.others.items() if name != "velocity"}
    return replace(recording, others=others), [Finding(kind="velocity", repaired=True, text=text)]
