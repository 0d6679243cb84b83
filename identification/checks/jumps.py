"""Values that jump and do not return, or return later: concatenated experiments, drop-outs.

For any torque, straight lines through a few samples before and after a time step meet within the step, except for the
curvature of the motion. A jump is a mismatch that is too large for that curvature, for a change of speed at an unknown
instant within the step, and compared with all other mismatches in the log.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identification.checks.faults import quantum
from identification.recording import Array, Checked, Finding, Recording, counted

_SIDE = 6  # samples on either side
_OVER_ELSEWHERE, _OVER_MISFIT, _OVER_SPEED, _OVER_QUANTUM = 5.0, 8.0, 3.0, 6.0
_FEW = 200  # least samples per jump: more frequent ones belong to the machine
_LONGEST_DROPOUT = 0.1  # of the samples


def find_jumps(values: Array, time: Array, step: float) -> tuple[NDArray[np.int64], Array]:
    """Indices (N,) of the first samples after a jump and the sizes (N,) of the jumps."""
    none = np.empty(0, dtype=np.int64), np.empty(0)
    count = len(values)
    if count < 10 * _SIDE:
        return none
    size, misfit, speed = _mismatch(values)
    size_left = np.abs(size)
    candidate = (
        (size_left > _OVER_MISFIT * misfit) & (size_left > _OVER_SPEED * speed) & (size_left > _OVER_QUANTUM * step)
    )
    steps = np.diff(time)[_SIDE - 1 : count - _SIDE]
    candidate &= steps < 1.5 * np.median(steps)
    places = np.flatnonzero(candidate)
    # A jump may be visible at neighbouring samples too: keep the greatest within a window.
    standing = np.where(candidate, size_left, 0.0)
    places = np.array(
        [p for p in places if standing[p] == standing[max(0, p - _SIDE) : p + _SIDE + 1].max()], dtype=int
    )
    if len(places) == 0:
        return none
    away = np.ones(len(size_left), dtype=bool)
    for place in places:
        away[max(0, place - 2 * _SIDE) : place + 2 * _SIDE + 1] = False
    elsewhere = float(size_left[away].max(initial=0.0))
    places = places[np.argsort(size_left[places])]
    for kept in range(len(places)):  # jumps of the machine are many and of all sizes: find a gap
        below = max(elsewhere, float(size_left[places[kept - 1]]) if kept else 0.0)
        rest = len(places) - kept
        if size_left[places[kept]] > _OVER_ELSEWHERE * below and rest * _FEW <= max(count, _FEW):
            chosen = np.sort(places[kept:])
            return chosen + _SIDE, size[chosen]
    return none


def _mismatch(values: Array) -> tuple[Array, Array, Array]:
    """For each time step: mismatch of the two lines, their worst misfit, and the sum of both speeds per sample."""
    windows = np.lib.stride_tricks.sliding_window_view(values - values.mean(), 2 * _SIDE)
    place = np.arange(_SIDE) - (_SIDE - 1) / 2
    centre = np.full(_SIDE, 1 / _SIDE)
    slope = place / float(place @ place)
    before, after = windows[:, :_SIDE], windows[:, _SIDE:]
    ahead = before @ centre + before @ slope * (_SIDE / 2)
    back = after @ centre - after @ slope * (_SIDE / 2)
    left = before - (before @ centre)[:, None] - (before @ slope)[:, None] * place
    right = after - (after @ centre)[:, None] - (after @ slope)[:, None] * place
    misfit = np.maximum(np.abs(left).max(axis=1), np.abs(right).max(axis=1))
    return back - ahead, misfit, np.abs(before @ slope) + np.abs(after @ slope)


def mask_dropouts(recording: Recording) -> Checked:
    """Mask samples that jump to one value, stay exactly constant, and jump back."""
    values, valid = recording.output, recording.valid
    dropped = np.zeros(len(values), dtype=bool)
    places, sizes = find_jumps(values, recording.time, quantum(values[valid]))
    for (start, stop), (there, back) in zip(pairwise(places), pairwise(sizes), strict=True):
        still = np.ptp(values[start:stop]) == 0 and not dropped[start - 1]
        if still and there * back < 0 and stop - start <= _LONGEST_DROPOUT * len(values):
            dropped[start:stop] = True
    if not dropped.any():
        return recording, []
    index = np.arange(len(values))
    first = int(np.flatnonzero(dropped)[0])
    text = (
        f"{recording.where(first)}: '{recording.name('output')}' drops out to {values[first]:.6g} "
        f"{'rad' if recording.axis == 'rotary' else 'm'}, {counted(int(dropped.sum()), 'sample')} masked"
    )
    masked = replace(recording, output=np.interp(index, index[~dropped], values[~dropped]), valid=valid & ~dropped)
    return masked, [Finding(kind="drop-out", repaired=True, text=text)]


def split_at_jumps(recording: Recording) -> tuple[list[Recording], list[Finding]]:
    """Split the recording where the output jumps further than any motion and stays at the new level."""
    places, sizes = find_jumps(recording.output, recording.time, quantum(recording.output[recording.valid]))
    sound = [bool(recording.valid[p - 2 : p + 2].all()) for p in places]
    places, sizes = places[sound], sizes[sound]
    if len(places) == 0:
        return [recording], []
    edges = [0, *places.tolist(), len(recording)]
    parts = [
        recording.take(slice(a, b), label=f"{recording.label} piece {k + 1}")
        for k, (a, b) in enumerate(pairwise(edges))
    ]
    unit = "rad" if recording.axis == "rotary" else "m"
    more = f", and {counted(len(places) - 1, 'further jump')}" if len(places) > 1 else ""
    text = (
        f"{recording.where(int(places[0]))}: '{recording.name('output')}' jumps by {sizes[0]:.4g} {unit} within a "
        f"sample, which no motion can{more}: experiments glued together or a slipped encoder, so the run is split into "
        f"{len(parts)} pieces with initial states of their own"
    )
    return parts, [Finding(kind="jump", repaired=True, text=text)]
