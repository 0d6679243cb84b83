"""Missing samples: outputs are interpolated and masked, commands are held, broken optional channels are dropped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.recording import Array, Checked, Finding, Recording, counted
from plant.number import HUGE

AFTER_HELD = 10  # samples that are disturbed after a held command


def fill_command(recording: Recording) -> Checked:
    """Hold the last command over a few missing ones, and mask the disturbed output."""
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
        servo_damping=recording.servo_damping[last],
        valid=recording.valid & ~disturbed,
    )
    return repaired, [Finding(kind="missing command", repaired=True, text=text)]


def fill_output(recording: Recording) -> Checked:
    """Interpolate missing and masked outputs, so that every sample is a finite number."""
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
    filled = replace(recording, output=bridge(output, known), valid=recording.valid & known)
    return filled, [Finding(kind="missing output", repaired=True, text=text)]


def fill_others(recording: Recording) -> Checked:
    """Repair optional channels: small gaps are interpolated, a broken channel is dropped."""
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
            others[name] = bridge(values, known)
            text = f"{where}: {share} interpolated"
        else:
            text = f"{where}: {share}, the channel is not used"
        findings.append(Finding(kind=f"missing {name}", repaired=True, text=text))
    return (replace(recording, others=others), findings) if findings else (recording, [])


def bridge(values: Array, known: NDArray[np.bool_]) -> Array:
    """The values (T,), interpolated over the unknown samples."""
    index = np.arange(len(values))
    return np.interp(index, index[known], values[known])


def _refuse_huge(recording: Recording, values: Array, name: str) -> None:
    size = np.abs(np.where(np.isfinite(values), values, 0.0))
    if len(size) and size.max() > HUGE:
        raise MalformedLog(
            f"{recording.where(int(size.argmax()))}: '{name}' is {values[size.argmax()]:.3g}, which no drive can "
            "reach; check the file and the units."
        )
    if len(size) and 0.0 < size.max() < 1 / HUGE:
        raise MalformedLog(
            f"{recording.label}: '{name}' is {size.max():.3g} at most, which no sensor can show; check its unit."
        )
