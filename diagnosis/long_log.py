"""Stretches of a log that is too long for the search, spread over its runs."""

from __future__ import annotations

from dataclasses import replace

from identification.log import Log
from identification.run import Run

LONGEST = 50_000
"""Largest number of samples in a search: each takes about 5 kB and 1 ms."""
_PIECES = 5  # each is long enough for slow motions; several show changes over time


def stretches(log: Log) -> tuple[Log, str | None]:
    """The log and None; if it is too long, stretches of it as separate runs and a sentence about this."""
    samples = sum(map(len, log.runs))
    if samples <= LONGEST:
        return log, None
    length, starts = LONGEST // _PIECES, [(samples - LONGEST // _PIECES) * k // (_PIECES - 1) for k in range(_PIECES)]
    first, found = 0, list[Run]()
    for run in log.runs:
        for start in starts:
            begin, end = max(start - first, 0), min(start + length - first, len(run))
            if end - begin >= length // 10:  # a stretch may continue in the next run; short pieces are left out
                found.append(replace(run.slice(begin, end), label=f"{run.label} from {run.time[begin]:.4g} s"))
        first += len(run)
    used = sum(map(len, found))
    sentence = f"The log has {samples:,} samples. {len(found)} stretches of it are used, {used:,} samples in all."
    return replace(log, runs=tuple(found)), sentence
