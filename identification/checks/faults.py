"""Faults of a single measured channel: spikes, counter wraps, clipping, freezing.

Each detector takes one channel and its encoder step and returns the faulty samples; none of them changes anything.
Motion, steps, stick-slip and noise must not be detected: a fault must exceed its neighbourhood by a multiple.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identification.recording import Array

_FLANK = 5  # samples on either side with which a spike is compared
_WIDEST_SPIKE = 4
_OVER_FLANK, _OVER_NOISE, _OVER_QUANTUM = 8.0, 10.0, 5.0


def quantum(values: Array) -> float:
    """The smallest step between two neighbouring samples, 0 for a constant channel; rounding errors do not count."""
    steps = np.abs(np.diff(values))
    steps = steps[steps > 1e-13 * np.abs(values).max(initial=0.0)]
    return float(steps.min()) if len(steps) else 0.0


def find_spikes(values: Array, step: float) -> NDArray[np.bool_]:
    """Mask (T,) of isolated jumps that return within a few samples, such as those of a bus fault.

    A parabola through five samples on either side predicts the samples between. They are a spike if each is off by
    more than 8 times the worst misfit of the flanks (so that bends, steps and ringing are not detected), 10 times the
    local noise, and 5 encoder steps.
    """
    spikes = np.zeros(len(values), dtype=bool)
    if len(values) < 4 * _FLANK:
        return spikes
    index = np.arange(len(values))
    cleaned = values
    for _ in range(3):  # a small spike near a large one is found once that one is removed
        found = _spike_pass(cleaned, step)
        if not np.any(found & ~spikes):
            break
        spikes |= found
        cleaned = np.interp(index, index[~spikes], values[~spikes])
    return spikes


def _spike_pass(values: Array, step: float) -> NDArray[np.bool_]:
    from scipy.ndimage import median_filter

    count = len(values)
    spikes = np.zeros(count, dtype=bool)
    ends = np.median(values[:_FLANK]), np.median(values[-_FLANK:])
    padded = np.pad(values, _FLANK, constant_values=ends)
    noise: Array = np.zeros(1)
    for width in range(1, _WIDEST_SPIKE + 1):
        predict, misfit, flank = _parabola(width)
        length = 2 * _FLANK + width
        windows = np.lib.stride_tricks.sliding_window_view(padded, length)
        off = np.stack(
            [padded[_FLANK + k : _FLANK + k + len(windows)] - np.correlate(padded, predict[k]) for k in range(width)]
        )
        least = np.abs(off).min(axis=0)
        if width == 1:
            noise = 1.4826 * np.maximum(np.median(least), median_filter(least, size=min(101, count), mode="reflect"))
            noise = np.append(noise, np.repeat(noise[-1], _WIDEST_SPIKE))
        limit = np.maximum(_OVER_NOISE * noise[: len(least)], _OVER_QUANTUM * step)
        for start in np.flatnonzero(least > limit):
            if least[start] > _OVER_FLANK * np.abs(misfit @ windows[start, flank]).max():
                spikes[start : start + width] = True
    return spikes


def _parabola(width: int) -> tuple[Array, Array, NDArray[np.int64]]:
    """Prediction (width, window) of the middle, misfit (10, 10) of the flanks, and their indices in the window."""
    place = np.arange(2 * _FLANK + width)
    flank = np.r_[place[:_FLANK], place[-_FLANK:]]
    basis = np.vander((place - place.mean()) / _FLANK, 3)
    solve = np.linalg.pinv(basis[flank])
    predict = np.zeros((width, len(place)))
    predict[:, flank] = basis[_FLANK : _FLANK + width] @ solve
    return predict, np.eye(len(flank)) - basis[flank] @ solve, flank.astype(np.int64)


def find_wraps(values: Array, index: NDArray[np.int64], turn: float | None, step: float) -> tuple[Array, float]:
    """Offsets (T,) that continue a counter which wrapped around, and its period (0 if it never did).

    A wrap is a jump across nearly the whole range of the values, with the same motion before and after it, by a typical
    period of counters: `turn` times a power of two (1 and up), or 2^8 to 2^32 encoder steps. `index` (T,) counts the
    samples, because invalid ones may be left out of `values`.
    """
    none = np.zeros(len(values)), 0.0
    if len(values) <= 8:
        return none
    steps, spacing = np.diff(values), np.diff(index)
    span = float(np.diff(np.quantile(values, (0.005, 0.995)))[0])  # of all but single spikes
    jumps = np.flatnonzero(np.abs(steps) > 0.8 * span)
    if span == 0 or len(jumps) == 0 or len(jumps) > len(values) // 2:
        return none
    usual_jump = float(np.median(np.abs(steps[jumps])))
    turns = np.empty(0) if turn is None else turn * 2.0 ** np.arange(0, 17)
    known = turns[np.abs(turns / usual_jump - 1) < 0.1]
    known = known if len(known) else step * 2.0 ** np.arange(8, 33)
    period = float(known[np.argmin(np.abs(known - usual_jump))])
    motion = (steps - period * np.round(steps / period)) / spacing
    usual = np.array([np.median(np.abs(motion[max(0, j - 5) : j + 6])) for j in jumps]) * spacing[jumps]
    noise = 1.4826 * float(np.median(np.abs(motion - np.median(motion))))
    slack = 3 * usual + 2 * step + 6 * noise
    same_size = np.abs(motion * spacing)[jumps] <= slack
    if np.mean(same_size) < 0.9 or np.any(period < 8 * usual) or np.ptp(values) < 0.8 * period or span > 1.02 * period:
        return none
    return np.append(0.0, -period * np.cumsum(np.round(steps / period))), period


def find_flat_tops(values: Array, step: float) -> NDArray[np.bool_]:
    """Mask (T,) of samples at the channel's end of scale that is reached and left at speed: a clipped signal.

    A held step is at its extreme too, but the samples next to it do not point beyond it. A smooth peak slows down
    before it reverses. A load that friction stops slows down before, and leaves slowly. If the sampling is so slow that
    the speed changes within a sample elsewhere too, nothing is detected.
    """
    clipped = np.zeros(len(values), dtype=bool)
    if len(values) < 7:
        return clipped
    ends = (values == values.max()) | (values == values.min())
    curvature = np.abs(np.diff(values, 2))[np.convolve(ends, np.ones(7), "same")[1:-1] == 0]
    least = max(10 * step, 2 * float(np.quantile(curvature, 0.99)) if len(curvature) else 0.0)
    for extreme, sign in ((values.max(), 1.0), (values.min(), -1.0)):
        room = sign * (extreme - values)  # from each sample to the end of scale
        tops = [(start, stop) for start, stop in stretches(room == 0) if stop - start >= 3]
        cut = sum(
            _steady(room[start - 3 : start][::-1], least) and _steady(room[stop : stop + 3], least)
            for start, stop in tops
            if start >= 3 and stop + 3 <= len(values)
        )
        if 2 * cut > len(tops) and sum(stop - start for start, stop in tops) >= 5:
            for start, stop in tops:
                clipped[start:stop] = True
    return clipped


def _steady(room: Array, least: float) -> bool:
    """True if the distance (3,) to the end of scale grows at once, and by more than `least` per sample.

    From rest, at a constant acceleration, the second increment is 5/3 to 3 times the first; next to a clipped peak it
    is at most 1.4 times the first.
    """
    first, second = np.diff(room)
    slope = (first + second) / 2
    return bool(slope > least and room[0] <= 1.2 * slope and second < 1.5 * first)


def find_frozen(values: Array, step: float) -> NDArray[np.bool_]:
    """Mask (T,) of values that are constant for five samples or more during motion and then catch up."""
    frozen = np.zeros(len(values), dtype=bool)
    for start, stop in stretches(np.append(np.diff(values) == 0, False)):
        stop += 1  # a stretch of equal differences has one sample more
        if stop - start < 5 or start < 3 or stop + 1 >= len(values):
            continue
        slope = (values[start] - values[start - 3]) / 3
        jump, after = np.sign(slope) * np.diff(values[stop - 1 : stop + 2])
        # A stuck load starts slowly; a stuck measurement catches up with all the missed motion at once.
        if abs(slope) > 3 * step and jump > 0.4 * abs(slope) * (stop - start) and abs(after) < 0.5 * jump:
            frozen[start + 1 : stop] = True
    return frozen


def stretches(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """(start, stop) of each unbroken stretch of True."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
