"""Division into estimation and validation data.

Validation data may reject an effect, but they choose no parameter value and favour no effect.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identification.errors import Unidentifiable
from identification.log import Log
from identification.run import Run
from plant.effects.effect import Array

_SHARE = 0.3  # of a single run that is held out, at its end
_BLOCKS, _IDLE = 100, 0.02  # blocks of a log; share of the largest travel in a block below which the load is at rest
_LEAST = 50  # least number of samples of a run


def parts(log: Log, held_out: Log | None) -> tuple[Log, Log, list[str]]:
    """Estimation log, held-out log, and sentences about them; held-out runs at standstill are not used.

    Args:
        log: the whole log, or the estimation log if `held_out` is given.
        held_out: validation data chosen by the user, if any.
    """
    if held_out is None:
        log, held_out, sentence = split(log)
        return log, held_out, [sentence]
    moving = tuple(run for run in held_out.runs if _lively(run, log).any())
    if not moving:
        log, held_out, sentence = split(log)
        return (
            log,
            held_out,
            [f"The load stands still in that part, so another part is used for validation. {sentence}"],
        )
    still = [run.label for run in held_out.runs if run not in moving]
    notes = [f"The held-out part stands still in {', '.join(still)}, which is left out."] if still else []
    return log, replace(held_out, runs=moving), notes


def fitted_too(log: Log, held_out: Log) -> str | None:
    """Label of a held-out run that is one of the fitted runs, under another name perhaps; None if there is none."""

    def same(one: Run, other: Run) -> bool:
        pairs = ((one.time, other.time), (one.command, other.command), (one.measured, other.measured))
        return all(np.array_equal(a, b) for a, b in pairs)

    return next((run.label for run in held_out.runs if any(same(run, one) for one in log.runs)), None)


def split(log: Log) -> tuple[Log, Log, str]:
    """Estimation log, held-out log, and a sentence that describes the division.

    Several runs: every third moving run, or else the last one, is held out. A single run: its last
    30 %. If the load stands still there, 30 % of the moving part: the last, the first or the middle, the first of these
    that moves.
    """
    if len(log.runs) > 1:
        moving = [place for place, run in enumerate(log.runs) if moves(run, log)]
        choice = moving if len(moving) > 1 else list(range(len(log.runs)))
        held = choice[2::3] or [choice[-1]]
        kept = [place for place in range(len(log.runs)) if place not in held]
        labels = ", ".join(log.runs[place].label for place in held)
        estimation = replace(log, runs=tuple(log.runs[place] for place in kept))
        return estimation, replace(log, runs=tuple(log.runs[place] for place in held)), f"Validation data: {labels}."
    (run,) = log.runs
    cut = int(len(run) * (1.0 - _SHARE))
    begins = f"from {_clock(run, cut)} s"
    first, last = run.slice(0, cut), replace(run.slice(cut, None), label=f"{run.label} {begins}")
    if moves(last, log):
        sentence = f"Validation data: the last {100 * _SHARE:.0f} % of the only run, {begins} on."
        return replace(log, runs=(first,)), replace(log, runs=(last,)), sentence
    return _moving_part(log)


def split_otherwise(log: Log) -> tuple[Log, Log, str] | None:
    """Another division, with the validation data of `split` in the estimation log; None if nothing else moves.

    Several runs: the first and every third of those that move. A single run: its first 30 %.
    """
    if len(log.runs) > 1:
        moving = [place for place, run in enumerate(log.runs) if moves(run, log)]
        held = tuple(log.runs[place] for place in moving[::3])
        kept = tuple(run for run in log.runs if run not in held)
        if len(moving) < 2:
            return None
        labels = ", ".join(run.label for run in held)
        return replace(log, runs=kept), replace(log, runs=held), f"Validation data: {labels}."
    (run,) = log.runs
    cut = int(len(run) * _SHARE)
    until = f"until {_clock(run, cut - 1)} s"
    first, last = replace(run.slice(0, cut), label=f"{run.label} {until}"), run.slice(cut, None)
    if not (moves(first, log) and moves(run.slice(len(run) - cut, None), log)):
        return None  # if the end is at standstill, `split` has taken another part, perhaps this one
    sentence = f"Validation data: the first {100 * _SHARE:.0f} % of the only run, {until}."
    return replace(log, runs=(last,)), replace(log, runs=(first,)), sentence


def _moving_part(log: Log) -> tuple[Log, Log, str]:
    """Division of a single run with standstill at its end: idle ends are left out, 30 % of the rest is held out.

    Raises `Unidentifiable` if the rest is too short to be divided.
    """
    (run,) = log.runs
    lively = np.flatnonzero(_lively(run, log))
    begin, end = int(lively[0]), int(lively[-1]) + 1
    length = int(_SHARE * (end - begin))
    starts = (end - length, begin, (begin + end - length) // 2)
    start = next((k for k in starts if moves(run.slice(k, k + length), log)), starts[0])
    stop = start + length
    span = f"from {_clock(run, start)} to {_clock(run, stop - 1)} s"
    held = replace(run.slice(start, stop), label=f"{run.label} {span}")
    kept = tuple(run.slice(*part) for part in ((begin, start), (stop, end)) if part[1] - part[0] >= _LEAST)
    if not kept:
        raise Unidentifiable(
            f"The load moves in {end - begin} samples of this log only, too few for a model and a part for validation; "
            "record a longer motion, or give validation data with --holdout (in Python holdout=...)."
        )
    sentence = f"Validation data: {span} of the only run; standstill at its ends is left out."
    return replace(log, runs=kept), replace(log, runs=(held,)), sentence


def moves(run: Run, log: Log) -> bool:
    """Whether the share of time with motion is at least half of that in the log, for a run or a part of one."""
    whole = np.concatenate([_lively(other, log) for other in log.runs])
    return bool(np.mean(_lively(run, log)) >= 0.5 * np.mean(whole))


def _lively(run: Run, log: Log) -> NDArray[np.bool_]:
    """(T,) whether the load moves: its travel in a block exceeds 2 % of the largest travel in any block."""
    width = max(2, sum(map(len, log.runs)) // _BLOCKS)
    most = max(float(_way(other, width).max()) for other in log.runs)
    return np.asarray(_way(run, width) > _IDLE * most)


def _way(run: Run, width: int) -> Array:
    """(T,) range of the output in blocks of so many samples, for each sample of the block."""
    edges = range(0, len(run), width)
    return np.concatenate([np.full(len(part := run.output[k : k + width]), np.ptp(part)) for k in edges])


def _clock(run: Run, place: int) -> str:
    """The time of a sample since the log's start [s]."""
    return f"{round(run.time[place] - run.start, 3):.10g}"
