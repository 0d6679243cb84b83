"""Channels that contradict each other: a set-point in degrees, a motor shaft in another unit, a pinion of other sign.

A set-point that cannot be used raises an error with the option that helps; the rest gives warnings. The scale of the
torque cannot be checked: a machine with twice the inertia, gravity and friction moves equally under twice the torque.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from identification.errors import MalformedLog
from identification.recording import Array, Finding, Recording

# Ratio of the motion of the output to that in the channel, and the units that would explain it.
_ANGLES = (
    (180 / np.pi, "deg", "rad"),
    (np.pi / 180, "rad", "deg"),
    (1 / (2 * np.pi), "turn", "rad"),
    (2 * np.pi, "rad", "turn"),
    (1e3, "mrad", "rad"),
    (1e-3, "rad", "mrad"),
)
_LENGTHS = ((1e3, "mm", "m"), (1e-3, "m", "mm"), (1e6, "um", "m"), (1e-6, "m", "um"))
_FOLLOWS = 0.9  # least correlation of a servo's output with its set-point
_ANSWERS = 0.5  # [s] longest delay of the output
_ONE_UNIT = 6.0  # ratio of output to set-point that no servo has if both are in one unit
_LARGEST_RATIO = 0.35  # largest logarithm of the ratio of two pinions of one gear
_SLOW_TO_FAST = 3.0  # ratio of load to motor that no reducing gear has


def check_setpoint_unit(recording: Recording) -> None:
    """Raise an error if the set-point of a position servo is in another unit than the output."""
    if not recording.servo_gain.any():
        return
    finding = _unit_of(recording, "setpoint")
    if finding is not None:
        raise MalformedLog(f"{finding.text}.")
    ratio = _ratio_to(recording, "setpoint")
    if ratio is not None and not 1.0 / _ONE_UNIT < abs(ratio) < _ONE_UNIT:
        raise MalformedLog(
            f"{recording.label}: '{recording.name('output')}' moves {abs(ratio):.3g} times as far as "
            f"'{recording.name('setpoint')}' asks, so the two are not in one unit: give that of each, for example "
            + (
                "--unit angle=turn/4096 --unit setpoint=turn/4096."
                if recording.axis == "rotary"
                else "--unit setpoint=mm."
            )
        )


def inconsistent_channels(recording: Recording) -> Iterable[Finding]:
    """Warn of channels with scales or signs that do not fit together."""
    for name in ("reference", "setpoint"):
        finding = _unit_of(recording, name)
        if finding is not None:
            yield finding
    yield from _shafts(recording)
    yield from _pinion_torques(recording)


def _unit_of(recording: Recording, name: str) -> Finding | None:
    """Finding on a reference or set-point that the output follows with the factor of a unit, or with the other sign."""
    ratio = _ratio_to(recording, name)
    if ratio is None:
        return None
    channel, output = recording.name(name), recording.name("output")
    column = "angle" if recording.axis == "rotary" else "position"
    for factor, of_output, of_wanted in _ANGLES if recording.axis == "rotary" else _LENGTHS:
        if ratio > 0 and abs(np.log(ratio / factor)) < 0.15:
            option = f"{name}={of_wanted}" if of_output in ("rad", "m") else f"{column}={of_output}"
            text = (
                f"{recording.label}: '{output}' moves {ratio:.4g} times as far as '{channel}', which is the factor "
                f"of a unit: try --unit {option}, or give the right unit of one of them"
            )
            return Finding(kind=f"unit of {name}", repaired=False, text=text)
    if -1.25 < ratio < -0.8:
        text = (
            f"{recording.label}: '{output}' moves against '{channel}', so one of them has the wrong sign: "
            f"--scale {name}=-1 turns it"
        )
        return Finding(kind=f"sign of {name}", repaired=False, text=text)
    return None


def _ratio_to(recording: Recording, name: str) -> float | None:
    """Ratio of the output to a reference or set-point, at once or with a small delay; None if uncorrelated."""
    wanted, output, sound = recording.others.get(name), recording.output, recording.valid
    if wanted is None:
        return None
    latest = min(round(_ANSWERS / float(np.median(np.diff(recording.time)))), len(output) // 10)
    later = range(0, latest + 1, max(1, latest // 50))
    found = [_slope(wanted[: len(wanted) - lag][sound[lag:]], output[lag:][sound[lag:]]) for lag in later]
    at_once, best = found[0], max(found)  # a reversed sign shows without delay
    correlation, ratio = at_once if abs(at_once[0]) >= _FOLLOWS else best
    return ratio if abs(correlation) >= _FOLLOWS else None


def _shafts(recording: Recording) -> Iterable[Finding]:
    """Both motors drive the same output gear: their shafts turn in the same direction, by the ratio of two gears."""
    turns = {name: recording.others[name] for name in ("angle_1", "angle_2") if name in recording.others}
    ratios = {name: _ratio(values, recording.output, recording, window=50) for name, values in turns.items()}
    known = {name: ratio for name, ratio in ratios.items() if ratio is not None}
    for name, ratio in known.items():
        if abs(ratio) > _SLOW_TO_FAST:
            text = (
                f"{recording.label}: '{recording.name('output')}' turns {abs(ratio):.4g} times as far as the motor "
                f"shaft '{recording.name(name)}', but a gear reduces: give the right units, perhaps --unit angle=deg"
            )
            yield Finding(kind=f"gear of {name}", repaired=False, text=text)
    if len(known) < 2:
        return
    first, second = known["angle_1"], known["angle_2"]
    ratio = second / first
    names = f"'{recording.name('angle_1')}' turns {ratio:.4g} times as far as '{recording.name('angle_2')}'"
    if ratio < 0:
        text = f"{recording.label}: {names}, but both drive one gear in the same direction: one has the wrong sign"
        yield Finding(kind="sign of a shaft", repaired=False, text=text)
    for factor in (180 / np.pi, 1e3):
        if abs(abs(np.log(abs(ratio))) - np.log(factor)) < _LARGEST_RATIO:
            column = "angle_1" if abs(ratio) > 1 else "angle_2"
            unit = "mrad" if factor == 1e3 else "deg"
            text = f"{recording.label}: {names}, which is about the factor of a unit: try --unit {column}={unit}"
            yield Finding(kind="unit of a shaft", repaired=False, text=text)


def _pinion_torques(recording: Recording) -> Iterable[Finding]:
    """If the torque at the output gear and those of the pinions were logged, the first is the sum by eq. (2)."""
    if "torque_1" not in recording.others or "torque_2" not in recording.others:
        return
    pinions = np.column_stack([recording.others["torque_1"], recording.others["torque_2"]])
    size = np.abs(pinions).max(axis=0)
    if not np.all(size > 0) or np.linalg.cond(pinions / size) > 1e3:
        return
    (first, second), *_ = np.linalg.lstsq(pinions / size, recording.command, rcond=None)
    left = recording.command - pinions / size @ np.array([first, second])
    if left @ left > 0.01 * float(recording.command @ recording.command):
        return
    first, second = first / size[0], second / size[1]
    statement = (
        f"{recording.label}: '{recording.name('command')}' is {first:+.4g} '{recording.name('torque_1')}' "
        f"{second:+.4g} '{recording.name('torque_2')}'"
    )
    if first * second < 0:
        text = f"{statement}, but two drives of one gear act in the same direction: one torque has the wrong sign"
        yield Finding(kind="sign of a torque", repaired=False, text=text)
    elif max(first / second, second / first) > 50:
        text = (
            f"{statement}, and no two gears differ so much: give the units of both, for example --unit torque_1='mN m'"
        )
        yield Finding(kind="unit of a torque", repaired=False, text=text)


def _ratio(channel: Array, output: Array, recording: Recording, window: int | None = None) -> float | None:
    """Slope of the output over a channel, or of their increments over 1/`window` of the log; None if uncorrelated."""
    sound = recording.valid
    if window is not None:
        span = max(1, len(output) // window)
        sound = sound[span:] & sound[:-span]
        channel, output = channel[span:] - channel[:-span], output[span:] - output[:-span]
    correlation, slope = _slope(channel[sound], output[sound])
    return slope if abs(correlation) >= _FOLLOWS else None


def _slope(one: Array, other: Array) -> tuple[float, float]:
    """Correlation and slope of a motion over the requested one; zeros if one of them is constant."""
    if len(one) < 2 or np.ptp(one) == 0 or np.ptp(other) == 0:
        return 0.0, 0.0
    one, other = one - one.mean(), other - other.mean()
    size = float(one @ one) * float(other @ other)
    shared = float(one @ other)
    return (shared / np.sqrt(size), shared / float(one @ one)) if size > 0 else (0.0, 0.0)
