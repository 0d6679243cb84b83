"""Checks of a recording: what is found is said, what is repaired is said, what cannot be used is refused.

Each check takes a `Recording` and returns it, repaired or not, with its findings; `check` runs them in order.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.faults import find_flat_tops, find_frozen, find_spikes, find_wraps, quantum, stretches
from identification.plausibility import check_time_unit, check_velocity_unit, warn_of_degrees
from identification.recording import HUGE, Array, Checked, Finding, Recording, counted
from identification.timing import check_time, jitter, mask_gaps, split_at_gaps, too_short, trim

AFTER_HELD = 10  # samples that a guessed command still disturbs


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
        f"{recording.where(first)}: {counted(missing, 'missing sample')} of '{name}' held from the sample before, and "
        f"{counted(int(disturbed.sum()), 'sample')} of '{recording.name('output')}' masked"
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
    text = f"{recording.where(first)}: {counted(int((~known).sum()), 'missing sample')} of '{name}' masked"
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
        share = f"{counted(int((~known).sum()), 'missing sample')} of '{recording.name(name)}'"
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
    found, samples = counted(len(stretches(spikes)), "spike"), counted(int(spikes.sum()), "sample")
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
            f"{_unit(recording)} {counted(len(turns), 'time')} and is continued"
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


def _unit(recording: Recording) -> str:
    return "rad" if recording.axis == "rotary" else "m"
