"""Checks of a recording: findings and repairs are reported; a recording that cannot be used raises an error.

Each check takes a `Recording` and returns it, repaired or not, with its findings; `check` runs them in order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from identification.checks.angle_unit import unit_of_the_angle, unit_of_the_velocity, wraps_in_degrees
from identification.checks.causality import cause_and_effect
from identification.checks.channels import check_setpoint_unit, inconsistent_channels
from identification.checks.faults import find_flat_tops, find_frozen, find_spikes, find_wraps, quantum, stretches
from identification.checks.jumps import mask_dropouts, split_at_jumps
from identification.checks.missing import bridge, fill_command, fill_others, fill_output
from identification.checks.plausibility import check_time_unit, check_velocity_unit
from identification.checks.rates import join_rows, on_output_samples
from identification.checks.repeats import drop_repeats
from identification.checks.size_alone import size_of_the_command
from identification.checks.speed_command import speed_for_torque
from identification.checks.timing import check_time, clock, mask_gaps, split_at_gaps, too_short, trim
from identification.errors import MalformedLog
from identification.recording import Checked, Finding, Recording, counted


def check(recording: Recording) -> tuple[list[Recording], list[Finding]]:
    """All checks, in an order in which no repair disturbs a later check.

    Returns the usable parts of the recording (none if all are too short) and the findings.
    Raises `MalformedLog` for a recording that cannot be used.
    """
    recording, findings = check_time(join_rows(recording))
    check_time_unit(recording)
    recording, found = on_output_samples(recording)
    findings += found
    recording, found = trim(recording)
    findings += found
    parts = _divide([recording], findings, split_at_gaps)
    parts = _divide(parts, findings, drop_repeats, fill_output, fill_command, fill_others)
    if recording.response == "velocity":  # it may jump, rest and reverse, and it is no counter
        parts = _divide(parts, findings, lambda part: ([part], []), mask_spikes)
    else:
        parts = _divide(parts, findings, split_at_jumps, mask_spikes, mask_dropouts, unwrap, mask_frozen)
    usable = []
    for part in parts:
        for repair in (mask_clipped, mask_gaps):
            part, found = repair(part)
            findings += found
        if np.mean(part.valid) < 0.5:
            raise MalformedLog(
                f"{part.label}: only {np.mean(part.valid):.0%} of the samples of '{part.name('output')}' can be used, "
                "record this run again or leave it out."
            )
        check_setpoint_unit(part)
        part, found = check_velocity_unit(part)
        findings += found
        for warn in WARNINGS if part.response == "angle" else _OF_A_VELOCITY:
            findings += warn(part)
        usable.append(part)
    return usable, findings


def _divide(
    parts: Iterable[Recording],
    findings: list[Finding],
    split: Callable[[Recording], tuple[list[Recording], list[Finding]]],
    *repairs: Callable[[Recording], Checked],
) -> list[Recording]:
    """Repair each part, split it, and keep the pieces that are long enough; the findings are appended to `findings`."""
    kept = []
    for part in parts:
        for repair in repairs:
            part, found = repair(part)
            findings += found
        pieces, found = split(part)
        findings += found
        for piece in pieces:
            short = too_short(piece)
            if short is None:
                kept.append(piece)
            else:
                findings.append(short)
    return kept


def mask_spikes(recording: Recording) -> Checked:
    """Mask isolated samples that jump away and return."""
    spikes = find_spikes(recording.output, _step(recording)) & recording.valid
    if not spikes.any():
        return recording, []
    output = bridge(recording.output, ~spikes)
    size = np.abs(output - recording.output)[spikes].max()
    found, samples = counted(len(stretches(spikes)), "spike"), counted(int(spikes.sum()), "sample")
    text = (
        f"{recording.where(int(np.flatnonzero(spikes)[0]))}: {found} of '{recording.name('output')}' "
        f"(up to {size:.3g} {_unit(recording)}), {samples} masked"
    )
    masked = replace(recording, output=output, valid=recording.valid & ~spikes)
    return masked, [Finding(kind="spikes", repaired=True, text=text)]


def unwrap(recording: Recording) -> Checked:
    """Continue counters that wrapped around, and mask the spikes that become visible near a wrap."""
    turn = 2 * np.pi if recording.axis == "rotary" else None
    findings = []
    channels = {"output": recording.output, **{k: recording.others[k] for k in recording.others if "angle_" in k}}
    for name, values in channels.items():
        sound = recording.valid if name == "output" else np.ones(len(values), dtype=bool)
        index = np.flatnonzero(sound)
        if name == "output" and turn and wraps_in_degrees(values[index], index):
            turn = 360.0
            text = f"{recording.label}: '{recording.name(name)}' wraps around by 360, as in degrees: --unit angle=deg"
            findings.append(Finding(kind="degrees", repaired=False, text=text, unusable=True))
        offsets, period = find_wraps(values[index], index, turn, quantum(values[index]))
        if not period:
            continue
        continued = values.copy()
        continued[index] += offsets
        channels[name] = bridge(continued, sound)
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
    """Mask a clipped output; only report a clipped command, because a limit before the drive is not a fault."""
    findings = []
    clipped = find_flat_tops(recording.output, _step(recording))
    if clipped.any() and recording.response == "angle":  # a velocity may be constant at its maximum
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
    """Mask samples that are constant during motion and then catch up."""
    frozen = find_frozen(recording.output, _step(recording)) & recording.valid
    if not frozen.any():
        return recording, []
    text = (
        f"{recording.where(int(np.flatnonzero(frozen)[0]))}: '{recording.name('output')}' freezes in motion, "
        f"{int(frozen.sum())} samples are masked"
    )
    return replace(recording, valid=recording.valid & ~frozen), [Finding(kind="frozen", repaired=True, text=text)]


def constant_channels(recording: Recording) -> Iterable[Finding]:
    """Report a load that never turns, and a command or other channels that are constant while it moves."""
    if np.ptp(recording.output[recording.valid]) == 0 and recording.response == "angle":
        text = (
            f"{recording.label}: '{recording.name('output')}' is constant, the load never turns; "
            "inertia and friction cannot be seen in this run; raise the command until it does"
        )
        yield Finding(kind="never turns", repaired=False, text=text)
    moving = np.ptp(recording.output) > 0
    away, came = np.ptp(recording.output), abs(recording.output[-1] - recording.output[0])
    passive = np.ptp(recording.command) == 0 and np.ptp(recording.servo_gain) == 0
    if moving and passive and (came < 0.5 * away or not recording.command.any()):  # else it is the answer to one step
        level = f"{recording.command[0]:.4g}" if recording.command.any() else "zero"
        text = (
            f"{recording.label}: '{recording.name('command')}' is {level} throughout while the load moves; if it is "
            "not what drives the load, name what does, for example --map current=NAME"
        )
        yield Finding(kind="no command", repaired=False, text=text)
    for name, values in recording.others.items():
        if moving and name in ("velocity", "angle_1", "angle_2") and np.ptp(values) == 0:
            text = f"{recording.label}: '{recording.name(name)}' is constant while the load moves, it is not connected"
            yield Finding(kind=f"frozen {name}", repaired=False, text=text)


WARNINGS = (
    clock,
    unit_of_the_angle,
    constant_channels,
    inconsistent_channels,
    cause_and_effect,
    speed_for_torque,
    size_of_the_command,
)


_OF_A_VELOCITY = (clock, unit_of_the_velocity, constant_channels)


def excited(recording: Recording) -> bool:
    """False if neither the command nor the output ever changes: no parameter can be identified."""
    passive = np.ptp(recording.command) == 0 and np.ptp(recording.servo_gain) == 0
    return not (passive and np.ptp(recording.output[recording.valid]) == 0)


def _step(recording: Recording) -> float:
    """Encoder step of the output, from valid samples only: interpolated ones lie between its steps."""
    return quantum(recording.output[recording.valid])


def _unit(recording: Recording) -> str:
    return ("rad" if recording.axis == "rotary" else "m") + "/s" * (recording.response == "velocity")
