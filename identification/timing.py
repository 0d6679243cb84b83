"""Checks of a recording's time: its order, its gaps, its unevenness, its ends.

Each takes a `Recording` and returns it, repaired or not, with its findings, as the checks of the channels do.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from identification.errors import MalformedLog
from identification.recording import HUGE, Checked, Finding, Recording, counted

MIN_SAMPLES, MIN_DURATION = 50, 0.2
GAP = 5.0  # median sample times
SPLIT_GAP = 1.0  # [s] too long to bridge with a held command


def check_time(recording: Recording) -> Checked:
    """Time must be finite and rise; a few repeated samples are left out."""
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
    count = int(repeated.sum())
    if count == 0:
        return recording, []
    first = recording.where(int(np.flatnonzero(repeated)[0]))
    if count > 0.01 * len(time):
        raise MalformedLog(
            f"{first}: {count} of {len(time)} samples repeat the time of the one before, "
            "export the time with more digits."
        )
    text = f"{first}: {counted(count, 'sample')} with a repeated time left out"
    return recording.take(~repeated), [Finding(kind="repeated time", repaired=True, text=text)]


def trim(recording: Recording) -> Checked:
    """Samples before both channels have begun, and after one has ended, are left out."""
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
    """A gap of more than a second ends an experiment: nobody knows the command in it."""
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
    """A recording from which nothing can be learned is left out."""
    duration = float(recording.time[-1] - recording.time[0]) if len(recording) else 0.0
    if len(recording) >= MIN_SAMPLES and duration >= MIN_DURATION:
        return None
    text = (
        f"{recording.label}: left out, as {len(recording)} samples in {duration:.3g} s are too short; "
        f"at least {MIN_SAMPLES} samples and {MIN_DURATION} s are needed"
    )
    return Finding(kind="too short", repaired=True, text=text)


def mask_gaps(recording: Recording) -> Checked:
    """The command inside a gap is unknown: as long again as the gap is masked after it."""
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


def jitter(recording: Recording) -> Iterable[Finding]:
    """Uneven sampling is kept as it is: the true times are used."""
    steps = np.diff(recording.time)
    usual = steps[steps <= GAP * np.median(steps)]
    spread = float(usual.std() / usual.mean())
    if spread > 0.05:
        text = f"{recording.label}: the sample time varies by {spread:.1%} (standard deviation), true times are used"
        yield Finding(kind="jitter", repaired=False, text=text)
