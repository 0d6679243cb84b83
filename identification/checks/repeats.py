"""A part of the log that occurs twice: a buffer that the logger wrote again.

Noise does not repeat. Fifty noisy values that occur again digit by digit, and with them the command and the velocity,
are the same measurements, whatever the load did. If the noise is below the encoder step (or absent, in a simulation), a
repeated motion may give the same values, and nothing is reported.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from identification.checks.faults import quantum, stretches
from identification.recording import Array, Finding, Recording

SHORTEST = 50  # samples
_CHANGES = 25  # least changes of the value in a repeated part: a load at rest repeats itself
_LEAST_NOISE = 0.3  # encoder steps; then two measurements of one angle agree in three of four cases at most


def find_repeats(values: Array) -> list[tuple[int, int, int]]:
    """(first, second, length) of parts of the values that occur twice."""
    if len(values) < 2 * SHORTEST or not _noisy(values):
        return []
    found: list[tuple[int, int, int]] = []
    covered = np.zeros(len(values), dtype=bool)
    for first, second in _candidates(values):
        if covered[second]:
            continue
        same = values[first:][: len(values) - second] == values[second:]
        stop = int(np.argmin(same)) if not same.all() else len(same)
        part = values[second : second + stop]
        if stop >= SHORTEST and np.count_nonzero(np.diff(part)) >= _CHANGES and len(np.unique(part)) >= 4:
            found.append((first, second, stop))
            covered[second : second + stop] = True
    return found


def _candidates(values: Array) -> list[tuple[int, int]]:
    """Pairs of indices whose next 16 values are equal, in order; windows with few changes are skipped."""
    width = 16
    digits = np.unique(values, return_inverse=True)[1].astype(np.uint64)
    with np.errstate(over="ignore"):
        weights = np.random.default_rng(0).integers(1, 2**63, width, dtype=np.uint64) | np.uint64(1)
        sums = np.zeros(len(values) - width + 1, dtype=np.uint64)
        for k in range(width):
            sums += weights[k] * digits[k : k + len(sums)]
    moving = np.concatenate(([0], np.cumsum(np.diff(values) != 0)))
    lively = moving[width - 1 :] - moving[: len(sums)] >= width // 2
    places = np.flatnonzero(lively)
    order = places[np.argsort(sums[places], kind="stable")]
    equal = sums[order[1:]] == sums[order[:-1]]
    starts = np.full(len(values), -1)
    for a, b in stretches(equal):
        starts[order[a + 1 : b + 1]] = order[a]
    seconds = np.flatnonzero(starts >= 0)
    begins = (
        seconds[np.append(True, (np.diff(seconds) > 1) | (np.diff(starts[seconds]) != 1))] if len(seconds) else seconds
    )
    return [(int(starts[second]), int(second)) for second in begins]


def _noisy(values: Array) -> bool:
    """True if the values have noise beyond the rounding to the encoder step.

    Sixth differences remove the motion; they multiply the variance of white noise by 924, and neighbours have a
    correlation of -6/7.
    """
    sixth = np.diff(values, 6)
    moving = np.abs(sixth) > 0
    if moving.sum() < SHORTEST:
        return False
    step = quantum(values)
    level = 1.4826 * float(np.median(np.abs(sixth))) / np.sqrt(924)
    alternate = float(sixth[1:] @ sixth[:-1]) / float(sixth @ sixth)
    return alternate < -0.7 and level**2 > step**2 * (1 / 12 + _LEAST_NOISE**2)


def _copied(channels: Iterable[Array], first: int, second: int, length: int) -> tuple[int, int, int]:
    """The longest stretch of a repeated part in which other channels are repeated too.

    An encoder may have the same value before or behind a copy by chance.
    """
    pairs = [(values[first:][:length], values[second:][:length]) for values in channels]
    same = np.all([(a == b) | (np.isnan(a) & np.isnan(b)) for a, b in pairs], axis=0)
    begin, end = max(stretches(same), key=lambda span: span[1] - span[0], default=(0, 0))
    return first + begin, second + begin, end - begin


def drop_repeats(recording: Recording) -> tuple[list[Recording], list[Finding]]:
    """Leave out the second copy of a part, and split the run there."""
    repeated = find_repeats(np.where(recording.valid, recording.output, np.nan))
    beside = (recording.command, *recording.others.values())
    found = [copy for part in repeated if (copy := _copied(beside, *part))[2] >= SHORTEST]
    if not found:
        return [recording], []
    keep = np.ones(len(recording), dtype=bool)
    for _, second, length in found:
        keep[second : second + length] = False
    first, second, length = found[0]
    spans = stretches(keep)
    parts = [recording.take(slice(a, b), label=f"{recording.label} stretch {k + 1}") for k, (a, b) in enumerate(spans)]
    more = f", and {len(found) - 1} parts more" if len(found) > 1 else ""
    text = (
        f"{recording.where(second)}: {length} samples of '{recording.name('output')}' are an exact copy of those from "
        f"row {recording.rows[first]} on, noise included{more}; the logger wrote them twice, so the copy is left out "
        f"and the run is split into {len(parts)}"
    )
    return parts, [Finding(kind="repeat", repaired=True, text=text)]
