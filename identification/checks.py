"""Checks of a recording: what is found is said, what is repaired is said, what cannot be used is refused.

Each check takes a `Recording` and returns it, repaired or not, with its findings; `check` runs them in order.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.faults import find_flat_tops, find_frozen, find_spikes, find_wraps, quantum, stretches
from identification.plausibility import check_time_unit, check_velocity_unit, warn_of_degrees
from identification.recording import Array, Finding, Recording

MIN_SAMPLES, MIN_DURATION = 50, 0.2
GAP = 5.0  # median sample times
SPLIT_GAP = 1.0  # [s] too long to bridge with a held command
HUGE = 1e12  # no servo's reading in SI units; beyond it squares lose their digits
AFTER_HELD = 10  # samples that a guessed command still disturbs

Checked = tuple[Recording, list[Finding]]


def check(recording: Recording) -> tuple[list[Recording], list[Finding]]:
    """All checks, in an order in which none trips over what the one before leaves.

    Returns the usable parts of the recording (none if all are too short) and the findings.
    Raises `MalformedLog` for what cannot be used.
    """
    recording, findings = check_time(recording)
    check_time_unit(recording)
    recording, found = trim(recording)
    findings += found
    usable = []
    parts, found = split_at_gaps(recording)
    findings += found
    for part in parts:
        short = too_short(part)
        if short is not None:
            findings.append(short)
            continue
        for step in (fill_output, fill_command, fill_others, mask_spikes, unwrap, mask_clipped, mask_frozen, mask_gaps):
            part, found = step(part)
            findings += found
        if np.mean(part.valid) < 0.5:
            raise MalformedLog(
                f"{part.label}: only {np.mean(part.valid):.0%} of the samples of '{part.name('output')}' can be used, "
                "record this run again or leave it out."
            )
        part, found = check_velocity_unit(part)
        findings += found
        findings += [*jitter(part), *warn_of_degrees(part), *constant_channels(part)]
        usable.append(part)
    return usable, findings


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
    text = f"{first}: {_count(count, 'sample')} with a repeated time left out"
    return recording.take(~repeated), [Finding(kind="repeated time", repaired=True, text=text)]


def trim(recording: Recording) -> Checked:
    """Samples before both channels have begun, and after one has ended, are left out."""
    command = np.isfinite(recording.command) & np.isfinite(recording.servo_gain)
    output = np.isfinite(recording.output)
    both = np.flatnonzero(command & output)
    if len(both) == 0 or len(both) == len(recording) or (both[0] == 0 and both[-1] == len(recording) - 1):
        return recording, []
    first, last = int(both[0]), int(both[-1])
    before, after = first, len(recording) - 1 - last
    index = 0 if before else last + 1
    name = recording.name("output" if command[index] else "command")
    text = (
        f"{recording.where(index)}: {before} samples at the start and {after} at the end are left out, as there "
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
        f"{recording.where(int(cuts[0]) + 1)}: {_count(len(cuts), 'gap')} of up to {steps.max():.3g} s, "
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


def fill_command(recording: Recording) -> Checked:
    """A few missing commands are held from the sample before, and the output they disturb is masked."""
    known = np.isfinite(recording.command) & np.isfinite(recording.servo_gain)
    name = recording.name("command")
    _refuse_huge(recording, recording.command, name)
    if known.all():
        return recording, []
    first = int(np.flatnonzero(~known)[0])
    missing = int((~known).sum())
    if missing > 0.01 * len(recording):
        raise MalformedLog(
            f"{recording.where(first)}: '{name}' is not a number in {missing} of {len(recording)} samples, "
            "and no motion can be predicted without it; repair or cut the log."
        )
    last = np.maximum.accumulate(np.where(known, np.arange(len(known)), 0))
    disturbed = np.convolve(~known, np.ones(AFTER_HELD + 1))[: len(known)] > 0
    text = (
        f"{recording.where(first)}: {_count(missing, 'missing sample')} of '{name}' held from the sample before, and "
        f"{_count(int(disturbed.sum()), 'sample')} of '{recording.name('output')}' masked"
    )
    repaired = replace(
        recording,
        command=recording.command[last],
        servo_gain=recording.servo_gain[last],
        valid=recording.valid & ~disturbed,
    )
    return repaired, [Finding(kind="missing command", repaired=True, text=text)]


def fill_output(recording: Recording) -> Checked:
    """Missing readings, and those that came masked, are interpolated, so that every sample is a sound number."""
    output, name = recording.output, recording.name("output")
    _refuse_huge(recording, np.where(recording.valid, output, 0.0), name)
    known = np.isfinite(output) & recording.valid
    if known.all():
        return recording, []
    first = int(np.flatnonzero(~known)[0])
    if known.sum() < 0.5 * len(output):
        raise MalformedLog(
            f"{recording.where(first)}: '{name}' is missing in {int((~known).sum())} of {len(output)} samples, "
            "export the channel again."
        )
    text = f"{recording.where(first)}: {_count(int((~known).sum()), 'missing sample')} of '{name}' masked"
    filled = replace(recording, output=_bridge(output, known), valid=recording.valid & known)
    return filled, [Finding(kind="missing output", repaired=True, text=text)]


def fill_others(recording: Recording) -> Checked:
    """Channels that the fit can do without: small holes are interpolated, a broken channel is dropped."""
    others: dict[str, Array] = {}
    findings = []
    for name, values in recording.others.items():
        known = np.isfinite(values) & (np.abs(np.nan_to_num(values, posinf=0, neginf=0)) < HUGE)
        if known.all():
            others[name] = values
            continue
        where = recording.where(int(np.flatnonzero(~known)[0]))
        share = f"{_count(int((~known).sum()), 'missing sample')} of '{recording.name(name)}'"
        if known.mean() >= 0.9:
            others[name] = _bridge(values, known)
            text = f"{where}: {share} interpolated"
        else:
            text = f"{where}: {share}, the channel is not used"
        findings.append(Finding(kind=f"missing {name}", repaired=True, text=text))
    return (replace(recording, others=others), findings) if findings else (recording, [])


def mask_spikes(recording: Recording) -> Checked:
    """Isolated readings that jump away and return are masked."""
    spikes = find_spikes(recording.output, _step(recording)) & recording.valid
    if not spikes.any():
        return recording, []
    output = _bridge(recording.output, ~spikes)
    size = np.abs(output - recording.output)[spikes].max()
    found, samples = _count(len(stretches(spikes)), "spike"), _count(int(spikes.sum()), "sample")
    text = (
        f"{recording.where(int(np.flatnonzero(spikes)[0]))}: {found} of '{recording.name('output')}' "
        f"(up to {size:.3g} {_unit(recording)}), {samples} masked"
    )
    masked = replace(recording, output=output, valid=recording.valid & ~spikes)
    return masked, [Finding(kind="spikes", repaired=True, text=text)]


def unwrap(recording: Recording) -> Checked:
    """Counters that wrapped around are continued, which also bares the spikes beside a wrap."""
    turn = 2 * np.pi if recording.axis == "rotary" else None
    findings = []
    channels = {"output": recording.output, **{k: recording.others[k] for k in recording.others if "angle_" in k}}
    for name, values in channels.items():
        sound = recording.valid if name == "output" else np.ones(len(values), dtype=bool)
        index = np.flatnonzero(sound)
        offsets, period = find_wraps(values[index], index, turn, quantum(values[index]))
        if not period:
            continue
        continued = values.copy()
        continued[index] += offsets
        channels[name] = _bridge(continued, sound)
        turns = np.flatnonzero(np.diff(offsets))
        text = (
            f"{recording.where(int(index[turns[0] + 1]))}: '{recording.name(name)}' wraps around by {period:.6g} "
            f"{_unit(recording)} {_count(len(turns), 'time')} and is continued"
        )
        findings.append(Finding(kind="counter wrap", repaired=True, text=text))
    if not findings:
        return recording, []
    output = channels.pop("output")
    recording, found = mask_spikes(replace(recording, output=output, others=recording.others | channels))
    return recording, findings + found


def mask_clipped(recording: Recording) -> Checked:
    """A clipped output is masked; a clipped command is only reported, for a limit before the drive is no fault."""
    findings = []
    clipped = find_flat_tops(recording.output, _step(recording))
    if clipped.any():
        text = (
            f"{recording.where(int(np.flatnonzero(clipped)[0]))}: '{recording.name('output')}' is clipped in "
            f"{int(clipped.sum())} samples, which are masked"
        )
        findings.append(Finding(kind="clipped output", repaired=True, text=text))
        recording = replace(recording, valid=recording.valid & ~clipped)
    saturated = find_flat_tops(recording.command, quantum(recording.command))
    if saturated.any():
        text = (
            f"{recording.where(int(np.flatnonzero(saturated)[0]))}: '{recording.name('command')}' is clipped in "
            f"{int(saturated.sum())} samples; if the drive was not limited there, the true value is unknown"
        )
        findings.append(Finding(kind="clipped command", repaired=False, text=text))
    return recording, findings


def mask_frozen(recording: Recording) -> Checked:
    """Readings that stand still in the midst of motion and then catch up are masked."""
    frozen = find_frozen(recording.output, _step(recording)) & recording.valid
    if not frozen.any():
        return recording, []
    text = (
        f"{recording.where(int(np.flatnonzero(frozen)[0]))}: '{recording.name('output')}' freezes in motion, "
        f"{int(frozen.sum())} samples are masked"
    )
    return replace(recording, valid=recording.valid & ~frozen), [Finding(kind="frozen", repaired=True, text=text)]


def mask_gaps(recording: Recording) -> Checked:
    """The command inside a gap is unknown: as long again as the gap is masked after it."""
    steps = np.diff(recording.time)
    gaps = np.flatnonzero(steps > GAP * np.median(steps))
    if len(gaps) == 0:
        return recording, []
    after = np.zeros(len(recording), dtype=bool)
    for gap in gaps:
        after |= (recording.time > recording.time[gap]) & (recording.time <= recording.time[gap + 1] + steps[gap])
    text = (
        f"{recording.where(int(gaps[0]) + 1)}: {_count(len(gaps), 'gap')} in time of up to {1e3 * steps.max():.3g} ms, "
        f"{_count(int(after.sum()), 'sample')} after it masked"
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


def constant_channels(recording: Recording) -> Iterable[Finding]:
    """A load that never turns shows only part of its parameters; a constant extra channel is likely unplugged."""
    if np.ptp(recording.output[recording.valid]) == 0:
        text = (
            f"{recording.label}: '{recording.name('output')}' is constant, the load never turns; "
            "inertia and friction cannot be seen in this run"
        )
        yield Finding(kind="never turns", repaired=False, text=text)
    moving = np.ptp(recording.output) > 0
    for name, values in recording.others.items():
        if moving and name in ("velocity", "angle_1", "angle_2") and np.ptp(values) == 0:
            text = f"{recording.label}: '{recording.name(name)}' is constant while the load moves, it is not connected"
            yield Finding(kind=f"frozen {name}", repaired=False, text=text)


def excited(recording: Recording) -> bool:
    """False when neither the command nor the output ever changes: nothing can be learned."""
    passive = np.ptp(recording.command) == 0 and np.ptp(recording.servo_gain) == 0
    return not (passive and np.ptp(recording.output[recording.valid]) == 0)


def _bridge(values: Array, known: NDArray[np.bool_]) -> Array:
    index = np.arange(len(values))
    return np.interp(index, index[known], values[known])


def _refuse_huge(recording: Recording, values: Array, name: str) -> None:
    size = np.abs(np.where(np.isfinite(values), values, 0.0))
    if len(size) and size.max() > HUGE:
        raise MalformedLog(
            f"{recording.where(int(size.argmax()))}: '{name}' is {values[size.argmax()]:.3g}, which no drive can "
            "reach; check the file and the units."
        )


def _step(recording: Recording) -> float:
    """Encoder step of the output; bridged samples lie between its steps."""
    return quantum(recording.output[recording.valid])


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


def _unit(recording: Recording) -> str:
    return "rad" if recording.axis == "rotary" else "m"
