"""Standstill at the ends of a recording, and recordings without motion: they have no information.

At standstill neither the command nor the output changes by more than its resolution and noise, estimated from the
standstill itself. A short part of it is kept: at the start for the initial state, at the end as it shows that the load
stays at rest. If a torque or a position loop holds the load, standstill has information about friction and gravity: it
may last as long as the motion, and a recording of it alone is kept. Standstill between motions is always kept.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identification.checks.faults import quantum
from identification.checks.timing import MIN_DURATION, MIN_SAMPLES
from identification.recording import Array, Finding, Recording

_FREE, _HELD = 0.1, 1.0  # of the length of the motion: longest standstill at an end
_SMALL = 0.05  # of a channel's range in the log: a larger change is not noise
_NOISE = 12.0  # standard deviations: largest range of noise (the deviation is known within a tenth)


def cut_standstill(
    recordings: Sequence[Recording], findings: Sequence[Finding]
) -> tuple[list[Recording], list[Finding]]:
    """Recordings without standstill at the ends, and without idle recordings; parts left out are added to `findings`.

    If all are idle, they are returned unchanged.
    """
    spans = {name: _span([getattr(one, name) for one in recordings]) for name in ("command", "output")}
    rests = [_rest(one, spans) for one in recordings]
    if all(rest == (len(one), len(one)) for one, rest in zip(recordings, rests, strict=True)):
        return list(recordings), list(findings)
    kept: list[Recording] = []
    reported = list(findings)
    for recording, (before, after) in zip(recordings, rests, strict=True):
        if before == len(recording):
            if _held(recording, slice(None), spans["command"]):
                kept.append(recording)
            else:
                text = f"{recording.label}: left out, as neither '{recording.name('command')}' nor the load moves in it"
                reported = [
                    one
                    for one in reported
                    if one.kind != "never turns" or not one.text.startswith(f"{recording.label}:")
                ]
                reported.append(Finding(kind="idle", repaired=True, text=text))
            continue
        cut, text = _cut(recording, before, after, spans["command"])
        kept.append(cut)
        reported += [Finding(kind="idle ends", repaired=True, text=text)] if text else []
    return kept, reported


def _span(channels: Sequence[Array]) -> float:
    return float(max(values.max() for values in channels) - min(values.min() for values in channels))


def _rest(recording: Recording, spans: dict[str, float]) -> tuple[int, int]:
    """Number of samples at standstill at the start, and at the end."""
    channels = [(getattr(recording, name), span) for name, span in spans.items()]
    gain = recording.servo_gain
    start = min(_still(values, span) for values, span in channels)
    end = min(_still(values[::-1], span) for values, span in channels)
    if np.ptp(gain) > 0:
        start, end = min(start, _still(gain, 0.0)), min(end, _still(gain[::-1], 0.0))
    return start, end


def _still(values: Array, span: float) -> int:
    """Number of first values (T,) that differ only by resolution and noise; the noise is from the first samples."""
    first = values[:MIN_SAMPLES]
    noise = float(np.std(np.diff(first))) / np.sqrt(2.0) if len(first) > 2 else 0.0
    least = min(max(1.5 * quantum(values), _NOISE * noise), _SMALL * span)
    moved = np.maximum.accumulate(values) - np.minimum.accumulate(values) > least
    return int(np.argmax(moved)) if moved.any() else len(values)


def _held(recording: Recording, rest: slice, span: float) -> bool:
    """Whether a torque or a position loop acts on the load at standstill."""
    return bool(np.any(recording.servo_gain[rest]) or abs(recording.command[rest].mean()) > _SMALL * span)


def _cut(recording: Recording, before: int, after: int, span: float) -> tuple[Recording, str]:
    """The recording with a short standstill at either end, and a sentence if it was shortened."""
    time, count = recording.time, len(recording)
    least = max(MIN_DURATION, MIN_SAMPLES * float(np.median(np.diff(time))))
    moving = float(time[count - 1 - after] - time[before]) if before + after < count else 0.0

    def kept(rest: slice) -> float:
        return max(moving * (_HELD if _held(recording, rest, span) else _FREE), least)

    first = int(np.searchsorted(time, time[before] - kept(slice(0, before)))) if before else 0
    last = count
    if after:
        end = time[count - 1 - after] + kept(slice(count - after, count))
        last = int(np.searchsorted(time, end, side="right"))
    first = first if time[first] - time[0] > least else 0  # a shorter cut is not made
    last = last if time[-1] - time[last - 1] > least else count
    if (first, last) == (0, count):
        return recording, ""
    ends = [
        f"the first {time[first] - time[0]:.3g} s" if first else "",
        f"the last {time[-1] - time[last - 1]:.3g} s" if last < count else "",
    ]
    text = (
        f"{recording.label}: {' and '.join(filter(None, ends))} are left out, as neither "
        f"'{recording.name('command')}' nor '{recording.name('output')}' changes there"
    )
    return recording.take(slice(first, last)), text
