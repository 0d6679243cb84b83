"""Test of the unit of an angle or a velocity: degrees show in the encoder step, the wraps and gravity.

Counts show as whole numbers. An unusual speed gives a warning only.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from identification.checks.faults import find_wraps, quantum
from identification.checks.filtered_motion import SURE, student, undisputed, views
from identification.recording import Array, Finding, Recording

FASTEST_LOAD = 1000.0  # [rad/s], 9550 rpm on the load's side
_LEVELS, _MOST_LINES = 20, 2**26  # least number of distinct values, most steps per turn
_COUNTS = {"rotary": ("angle", "turn/4096", "deg"), "linear": ("position", "mm/1000", "mm")}
_LUCK = 1e-3  # error of the exponent of two: one encoder in 500 is as near to a power by chance
_LEAST_EXPLAINED = 0.01  # least share of the torque's variance that gravity must explain


def unit_of_the_angle(recording: Recording) -> Iterable[Finding]:
    """An angle in degrees or counts makes the log unusable; an unusual speed gives a warning."""
    if in_whole_numbers(recording.output[recording.valid]):
        column, count, other = _COUNTS[recording.axis]
        text = (
            f"{recording.label}: '{recording.name('output')}' holds whole numbers only, as an encoder's counts: give "
            f"the size of one, for example --unit {column}={count}, or the unit, for example --unit {column}={other}"
        )
        yield Finding(kind="counts", repaired=False, text=text, unusable=True)
        return
    if recording.axis != "rotary" or "velocity" in recording.others:
        return
    output = recording.name("output")
    lines = encoder_lines(recording.output[recording.valid], 360.0)
    speed = float(np.quantile(np.abs(np.diff(recording.output) / np.diff(recording.time)), 0.99))
    reason = None
    if lines is not None:
        reason = f"has steps of 360/{lines}, as an encoder of {lines} steps a turn has in degrees"
    elif gravity_in_degrees(recording):
        reason = "is under a gravity torque that repeats every 360, as in degrees"
    if reason is not None:
        text = f"{recording.label}: '{output}' {reason}: --unit angle=deg"
        yield Finding(kind="degrees", repaired=False, text=text, unusable=True)
    elif speed > FASTEST_LOAD:
        text = f"{recording.label}: '{output}' moves at {speed:.3g} rad/s; if it is in degrees, say --unit angle=deg"
        yield Finding(kind="fast", repaired=False, text=text)


def unit_of_the_velocity(recording: Recording) -> Iterable[Finding]:
    """Warn of a velocity without a unit that looks like one in rpm: in whole numbers, or faster than any load."""
    if recording.axis != "rotary" or "velocity" in recording.stated:
        return
    values = recording.output[recording.valid]
    fast = float(np.quantile(np.abs(values), 0.99))
    if in_whole_numbers(values):
        how = "holds whole numbers only"
    elif fast > FASTEST_LOAD:
        how = f"reaches {fast:.3g} rad/s"
    else:
        return
    text = f"{recording.label}: '{recording.name('output')}' {how}; if it is in rpm, say --unit velocity=rpm"
    yield Finding(kind="rpm", repaired=False, text=text)


def in_whole_numbers(values: Array) -> bool:
    """Whether values (T,) are whole numbers, more than two; no encoder has a resolution of a radian or a metre."""
    return bool(np.all(values == np.round(values))) and len(np.unique(values)) > 2


def wraps_in_degrees(values: Array, index: NDArray[np.int64]) -> bool:
    """Whether values (T,) at samples `index` (T,) wrap around by 360; an angle in radians does not."""
    return find_wraps(values, index, 360.0, quantum(values))[1] == 360.0


def gravity_in_degrees(recording: Recording) -> bool:
    """Whether gravity fits the torque significantly better with the angle in degrees than in radians or as a spring.

    Within half a turn a sine cannot be distinguished from another curve, such as that of an end stop.
    """
    if recording.servo_gain.any() or np.ptp(recording.output[recording.valid]) < 180.0:
        return False
    part, seen = views(recording)
    statistics, explained = [], 0.0
    for view in seen:
        angle = view.behind(part.output)
        command = view.behind(part.command)
        other = [view.acceleration, *np.vander((angle - angle.mean()) / (angle.std() or 1.0), 4, increasing=True).T]
        as_read, in_degrees = (
            _left(command, [view.friction, *other, np.cos(x), np.sin(x)]) for x in (angle, np.deg2rad(angle))
        )
        statistics.append(student(as_read - in_degrees, as_read + in_degrees))
        explained = max(explained, float(np.mean(as_read - in_degrees)) / max(float(command.var()), 1e-300))
    return bool(statistics) and undisputed(statistics) > SURE and explained > _LEAST_EXPLAINED


def _left(command: Array, columns: Sequence[Array]) -> Array:
    """(N,) squared residuals of a command (N,) after regression on columns, which may be collinear."""
    basis = np.column_stack(columns)
    basis = basis / np.maximum(np.linalg.norm(basis, axis=0), 1e-300)
    left, size, _ = np.linalg.svd(basis, full_matrices=False)
    left = left[:, size > 1e-9 * size[0]]
    return np.asarray((command - left @ (left.T @ command)) ** 2)


def encoder_lines(values: Array, turn: float) -> int | None:
    """Steps per turn of the encoder that measured values (T,), if that is a power of two; else None.

    The step is refined over more and more values, so that its rounding in a file averages out. Values that are rounded
    to decimals have steps of 1, 2 or 5 of their last digit; a turn is not a power of two times such a step.
    """
    levels = np.unique(values)
    step = quantum(levels)
    if step == 0 or len(levels) < _LEVELS or turn / step > _MOST_LINES:
        return None
    gaps = np.diff(levels)
    gaps = gaps[gaps > 0.3 * step]  # smaller ones are two roundings of the same value
    usual = float(np.median(gaps[gaps < 1.7 * gaps.min()]))
    places, span = levels - levels[0], 16.0
    while True:
        near = places < span * usual
        whole = np.round(places[near] / usual)
        if whole[-1] > 0:
            usual = float(whole @ places[near] / (whole @ whole))
        if near.all():
            break
        span *= 2
    off = places - usual * np.round(places / usual)
    exponent = np.log2(turn / usual)
    error = float(off.std()) / (usual * whole[-1]) / np.log(2)  # of the exponent, at most
    if off.std() > 0.1 * usual or abs(exponent - np.round(exponent)) > max(4 * error, 1e-6):
        return None
    return int(2 ** np.round(exponent)) if 4 * error < _LUCK else None
