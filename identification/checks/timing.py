"""Checks of a recording's time: its order, its gaps, its jitter, its ends.

Each takes a `Recording` and returns it, repaired or not, with its findings, as the checks of the channels do.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.recording import Array, Checked, Finding, Recording, counted
from plant.number import HUGE

MIN_SAMPLES, MIN_DURATION = 50, 0.2
GAP = 5.0  # median sample times
SPLIT_GAP = 1.0  # [s] too long to bridge with a held command
DRIFT, DRIFT_BLOCKS = 2e-3, 12  # relative change of the sample time over the log; number of blocks of time


def check_time(recording: Recording) -> Checked:
    """Time must be finite and increase; a few samples with a repeated time are left out."""
    time = recording.time
    bad = np.flatnonzero(~np.isfinite(time))
    if len(bad):
        raise MalformedLog(f"{recording.where(int(bad[0]))}: the time is not a number, repair or delete this row.")
    if len(time) and np.abs(time).max() > HUGE:
        raise MalformedLog(f"{recording.label}: the time goes beyond {HUGE:.0e} s, give its unit: --unit time=UNIT.")
    back = np.flatnonzero(np.diff(time) < 0)
    if len(back):
        i = int(back[0]) + 1
        raise MalformedLog(
            f"{recording.where(i)}: the time goes back from {time[i - 1]:.6g} s, sort the rows or number the "
            "experiments in a column 'run'."
        )
    repeated = np.append(False, np.diff(time) == 0)
    copies = repeated & _as_before(recording)
    if copies.any() and np.array_equal(copies, repeated):
        first = recording.where(int(np.flatnonzero(copies)[0]))
        text = f"{first}: {counted(int(copies.sum()), 'row')} that repeat the row before are left out"
        return recording.take(~copies), [Finding(kind="repeated row", repaired=True, text=text)]
    count = int(repeated.sum())
    if count == 0:
        return recording, []
    first = recording.where(int(np.flatnonzero(repeated)[0]))
    if count > 0.01 * len(time):
        spread, digit = _spread(time)
        if spread is not None:
            text = (
                f"{first}: {count} of {len(time)} samples repeat the time of the one before, as times are written in "
                f"steps of {1e3 * digit:.4g} ms; the samples are spread evenly between them"
            )
            return replace(recording, time=spread), [Finding(kind="repeated time", repaired=True, text=text)]
        raise MalformedLog(
            f"{first}: {count} of {len(time)} samples repeat the time of the one before, "
            "export the time with more digits."
        )
    text = f"{first}: {counted(count, 'sample')} with a repeated time left out"
    return recording.take(~repeated), [Finding(kind="repeated time", repaired=True, text=text)]


def _as_before(recording: Recording) -> NDArray[np.bool_]:
    """(T,) whether a row has the same value in each channel as the row before."""
    same = np.ones(len(recording), dtype=bool)
    for values in (recording.command, recording.output, *recording.others.values()):
        gone = np.isnan(values)
        same[1:] &= (values[1:] == values[:-1]) | (gone[1:] & gone[:-1])
    return same


def _spread(time: Array) -> tuple[Array | None, float]:
    """Times (T,) of samples that share a time stamp, spread evenly between the stamps, and the step of the stamps.

    If all stamps are the truncated times of one even clock, that clock is used. None if the number of samples with a
    stamp is not proportional to the time until the next stamp.
    """
    first = np.flatnonzero(np.diff(time, prepend=-np.inf))
    counts = np.diff(first, append=len(time))
    until = np.diff(time[first])
    if len(until) < MIN_SAMPLES // 5:
        return None, 0.0
    digit = float(np.median(until))
    usual = until <= GAP * digit
    rate = float(counts[:-1][usual].sum() / until[usual].sum())
    if np.mean(np.abs(counts[:-1] - rate * until)[usual] <= 1.0 + 1e-6) < 0.95:
        return None, digit
    index = np.arange(len(time))
    line = np.polynomial.Polynomial.fit(index, time, 1)(index)
    if np.ptp(time - line) < 1.05 * digit:
        return np.asarray(line + (time[0] - line[0])), digit
    length = np.append(np.minimum(until, np.where(usual, until, counts[:-1] / rate)), counts[-1] / rate)
    stamp = np.repeat(np.arange(len(first)), counts)
    return time + (index - first[stamp]) / counts[stamp] * length[stamp], digit


def trim(recording: Recording) -> Checked:
    """Leave out the samples before both channels begin, and after one of them ends."""
    command = np.isfinite(recording.command) & np.isfinite(recording.servo_gain)
    output = np.isfinite(recording.output)
    both = np.flatnonzero(command & output)
    if len(both) == 0 or len(both) == len(recording) or (both[0] == 0 and both[-1] == len(recording) - 1):
        return recording, []
    first, last = int(both[0]), int(both[-1])
    before, after = counted(first, "sample"), len(recording) - 1 - last
    index = 0 if first else last + 1
    name = recording.name("output" if command[index] else "command")
    text = (
        f"{recording.where(index)}: {before} at the start and {after} at the end are left out, as there "
        f"'{name}' is not a number"
    )
    return recording.take(slice(first, last + 1)), [Finding(kind="trimmed", repaired=True, text=text)]


def split_at_gaps(recording: Recording) -> tuple[list[Recording], list[Finding]]:
    """Split the recording at gaps of more than a second: the command in a gap is unknown."""
    steps = np.diff(recording.time)
    if len(steps) == 0:
        return [recording], []
    cuts = np.flatnonzero((steps > SPLIT_GAP) & (steps > GAP * np.median(steps)))
    if len(cuts) == 0:
        return [recording], []
    edges = [0, *(cuts + 1).tolist(), len(recording)]
    parts = [
        recording.take(slice(a, b), label=f"{recording.label} part {k + 1}") for k, (a, b) in enumerate(pairwise(edges))
    ]
    text = (
        f"{recording.where(int(cuts[0]) + 1)}: {counted(len(cuts), 'gap')} of up to {steps.max():.3g} s, "
        f"the run is split into {len(parts)} parts with initial states of their own"
    )
    return parts, [Finding(kind="split", repaired=True, text=text)]


def too_short(recording: Recording) -> Finding | None:
    """Finding on a recording that is too short, else None."""
    duration = float(recording.time[-1] - recording.time[0]) if len(recording) else 0.0
    if len(recording) >= MIN_SAMPLES and duration >= MIN_DURATION:
        return None
    verb = "is" if len(recording) == 1 else "are"
    text = (
        f"{recording.label}: left out, as {counted(len(recording), 'sample')} in {duration:.3g} s {verb} too short; "
        f"at least {MIN_SAMPLES} samples and {MIN_DURATION} s are needed"
    )
    return Finding(kind="too short", repaired=True, text=text)


def mask_gaps(recording: Recording) -> Checked:
    """The command inside a gap is unknown: an equal time after the gap is masked."""
    steps = np.diff(recording.time)
    gaps = np.flatnonzero(steps > GAP * np.median(steps))
    if len(gaps) == 0:
        return recording, []
    after = np.zeros(len(recording), dtype=bool)
    for gap in gaps:
        after |= (recording.time > recording.time[gap]) & (recording.time <= recording.time[gap + 1] + steps[gap])
    found, masked = counted(len(gaps), "gap"), counted(int(after.sum()), "sample")
    text = (
        f"{recording.where(int(gaps[0]) + 1)}: {found} in time of up to {1e3 * steps.max():.3g} ms, "
        f"{masked} behind masked"
    )
    return replace(recording, valid=recording.valid & ~after), [Finding(kind="gaps", repaired=True, text=text)]


def clock(recording: Recording) -> Iterable[Finding]:
    """Report rounded times, jitter and a drifting clock; the times are used as they are."""
    steps = np.diff(recording.time)
    even = steps <= GAP * np.median(steps)
    usual = steps[even]
    mean, spread = float(usual.mean()), float(usual.std())
    digit = _rounding(usual)
    if digit and spread > 0.02 * mean:
        text = (
            f"{recording.label}: the sample time of {1e3 * mean:.4g} ms is written in steps of {1e3 * digit:.4g} ms, "
            f"so each time is wrong by up to {500 * digit:.3g} ms; export the time with more digits"
        )
        yield Finding(kind="rounded time", repaired=False, text=text)
    elif spread > 0.05 * mean:
        varies = f"{spread / mean:.1%} (standard deviation)"
        text = f"{recording.label}: the sample time varies by {varies}, true times are used"
        yield Finding(kind="jitter", repaired=False, text=text)
    first, last = _drift(np.cumsum(steps), steps, even)
    if abs(last - first) > DRIFT * mean:
        text = (
            f"{recording.label}: the clock drifts: the sample time changes steadily from {1e3 * first:.5g} ms to "
            f"{1e3 * last:.5g} ms ({(last - first) / first:+.2%}); the times are used as they are, check them against "
            "the drive's clock"
        )
        yield Finding(kind="drift", repaired=False, text=text)


def _rounding(steps: Array) -> float:
    """The last digit of times if all their steps are two neighbouring multiples of it; else 0."""
    digit = 10.0 ** np.floor(np.log10(np.ptp(steps) * 1.001)) if np.ptp(steps) > 0 else 0.0
    if digit == 0 or digit < 1e-9 or abs(np.ptp(steps) / digit - 1) > 1e-3:
        return 0.0
    whole = steps / digit
    low = round(float(whole.min()))
    shares = np.array([np.mean(np.abs(whole - n) < 1e-3) for n in (low, low + 1)])
    # Rounding keeps the error of each time below half a digit; a random mix of two steps lets it drift.
    error = np.cumsum(whole - whole.mean())
    return float(digit) if low > 0 and shares.sum() == 1 and shares.min() > 0.02 and np.ptp(error) < 1.5 else 0.0


def _drift(elapsed: Array, steps: Array, even: NDArray[np.bool_]) -> tuple[float, float]:
    """Sample time at both ends of a straight line through block means; equal if the means do not follow a line."""
    blocks = [k for k in np.array_split(np.arange(len(steps)), DRIFT_BLOCKS) if even[k].any()]
    means = np.array([steps[k][even[k]].mean() for k in blocks])
    level = float(means.mean())
    if len(blocks) < DRIFT_BLOCKS or len(steps) < 10 * DRIFT_BLOCKS:
        return level, level
    times = np.array([elapsed[k].mean() for k in blocks])
    slope, offset = np.polyfit(times - times.mean(), means, 1)
    left = means - offset - slope * (times - times.mean())
    if left.std() > 0.25 * means.std() or np.mean(np.sign(np.diff(means)) == np.sign(slope)) < 0.75:
        return level, level
    return float(offset - slope * (times.mean() - elapsed[0])), float(offset + slope * (elapsed[-1] - times.mean()))
