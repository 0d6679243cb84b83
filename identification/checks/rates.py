"""Channels that were sampled more slowly than the rows of the log: cells are empty or repeat the last sample.

Such cells are not samples and are not used. The samples of the output are the clock of the recording. The command is
held from one sample to the next; between two samples of the output its mean is used, which has the same impulse.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identification.checks.faults import quantum
from identification.recording import Array, Checked, Finding, Recording

_ENOUGH = 50  # least number of changes from which the sampling pattern is known


def on_output_samples(recording: Recording) -> Checked:
    """The recording at the samples of its output, if the output or the command is sampled more slowly than the rows."""
    command = np.isfinite(recording.command) & np.isfinite(recording.servo_gain)
    output = np.isfinite(recording.output) & recording.valid
    if not command.any() or not output.any():
        return recording, []
    findings = []
    for name, known in (("command", command), ("output", output)):
        if slower(known):
            rows = _rows(known)
            text = f"{recording.label}: '{recording.name(name)}' has a sample in every {rows} row only"
            findings.append(_slow(name, text + (", held in between" if name == "command" else "")))
    if not slower(output):
        held = held_for(recording.output, output)
        if held is not None:
            rows = _rows(held)
            text = f"{recording.label}: '{recording.name('output')}' repeats each sample until every {rows} row"
            findings.append(_slow("output", text))
            output = held
    for name, values in recording.others.items():
        if slower(np.isfinite(values)):
            text = f"'{recording.name(name)}' has a sample in every {_rows(np.isfinite(values))} row only, interpolated"
            findings.insert(0, _slow(name, f"{recording.label}: {text}"))
    if not findings:
        return recording, []
    if not any(finding.kind in ("slower command", "slower output") for finding in findings):
        output = np.ones(len(recording), dtype=bool)  # its few missing samples are masked later
    places = np.flatnonzero(output)
    if len(places) < len(recording):
        text = findings[-1].text + "; its own samples are used, and the mean of the command between them"
        findings[-1] = replace(findings[-1], text=text)
    latest = np.maximum.accumulate(np.where(command, np.arange(len(recording)), -1))

    def between(values: Array) -> Array:
        return _means(np.where(latest >= 0, values[latest], np.nan), recording.time, places)

    moved = replace(
        recording.take(places),
        command=between(recording.command),
        servo_gain=between(recording.servo_gain),
        servo_damping=between(recording.servo_damping),
        others={
            name: between(values) if name == "setpoint" else _at(values, places)  # like the command that it is
            for name, values in recording.others.items()
        },
    )
    return moved, findings


def _slow(name: str, text: str) -> Finding:
    return Finding(kind=f"slower {name}", repaired=True, text=text)


def join_rows(recording: Recording) -> Recording:
    """Join rows of the same time that have one channel each."""
    if len(recording) == 0:
        return recording
    instant = np.append(0, np.cumsum(recording.time[1:] != recording.time[:-1]))
    known = (np.isfinite(recording.command), np.isfinite(recording.output))
    twice = any(np.bincount(instant, weights=channel).max() > 1 for channel in known)
    if twice or instant[-1] == len(recording) - 1:
        return recording
    first = np.flatnonzero(np.diff(instant, prepend=-1))
    index = np.arange(len(recording))

    def latest(values: Array) -> Array:
        known = np.maximum.accumulate(np.where(np.isfinite(values), index, first[instant]))
        return values[known]

    joined = replace(
        recording,
        command=latest(recording.command),
        servo_gain=latest(recording.servo_gain),
        servo_damping=latest(recording.servo_damping),
        output=latest(recording.output),
        others={name: latest(values) for name, values in recording.others.items()},
    )
    return joined.take(np.append(first[1:] - 1, len(recording) - 1))


def slower(known: NDArray[np.bool_]) -> bool:
    """Whether most samples (T,) have rows without a sample between them: slower sampling, not a few missing samples."""
    places = np.flatnonzero(known)
    return len(places) > 2 and float(np.median(np.diff(places))) >= 2


def _rows(known: NDArray[np.bool_]) -> str:
    """Mean number of rows per sample, as an ordinal: "10th"."""
    number = round(float(np.mean(np.diff(np.flatnonzero(known)))))
    ending = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"


def held_for(values: Array, known: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
    """(T,) rows with a new sample, if each sample is repeated for the same number of rows; else None.

    Two changes are k or k + 1 rows apart, or a multiple of that if samples are equal, and never fewer. The steps must
    have many sizes: a slow load on an encoder moves by single counts.
    """
    if not known.all():
        return None
    steps = np.diff(values)
    changes = np.flatnonzero(steps) + 1
    if len(changes) < _ENOUGH:
        return None
    spacing = np.diff(changes)
    rows = int(np.quantile(spacing, 0.02))
    single = float(np.median(np.abs(steps[changes - 1]))) < 2.5 * quantum(values)
    if rows < 2 or single or np.median(spacing) > rows + 1:
        return None
    fresh = np.zeros(len(values), dtype=bool)
    usual = float(np.mean(spacing[spacing <= rows + 1]))
    early = changes[0] - np.round(usual * np.arange(1, int(changes[0] / usual) + 1)).astype(int)
    fresh[early] = True
    for first, last in pairwise([*changes, len(values)]):  # equal samples make a longer stretch
        samples = max(1, round((last - first) / usual))
        fresh[first + np.round(np.arange(samples) * (last - first) / samples).astype(int)] = True
    return fresh


def _means(held: Array, time: Array, places: NDArray[np.int64]) -> Array:
    """Mean of a value (T,) that is held from row to row, from each of the `places` to the next."""
    steps = np.diff(time, append=2 * time[-1] - time[-2])
    edges = np.append(places, len(time))
    sums = np.add.reduceat(held * steps, places)
    widths = np.add.reduceat(steps, places)
    constant = np.maximum.reduceat(held, places) == np.minimum.reduceat(held, places)
    return np.where(constant | (np.diff(edges) == 1), held[places], sums / widths)


def _at(values: Array, places: NDArray[np.int64]) -> Array:
    """Values (T,) at the rows `places`, interpolated from their samples if these are slower too."""
    known = np.isfinite(values)
    if not slower(known):
        return values[places]
    index = np.arange(len(values))
    return np.interp(places, index[known], values[known], left=np.nan, right=np.nan)
