"""Which rows of a table belong to one experiment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.errors import MalformedLog
from identification.recording import Array, Recording


def split_runs(whole: Recording, run: Array | None) -> tuple[Recording, ...]:
    """One recording for each value of the run column, in the order in which they come."""
    if run is None:
        return (whole,)
    odd = np.flatnonzero(~(np.isfinite(run) & (np.abs(run) < 2**31)) | (np.nan_to_num(run) % 1 != 0))
    if len(odd):
        raise MalformedLog(f"{whole.where(int(odd[0]))}: the run is {run[odd[0]]:g}, number the runs 0, 1, 2, ...")
    numbers, first = np.unique(run, return_index=True)
    return tuple(
        replace(whole.take(run == number, label=f"{whole.label} run {int(number)}"), number=int(number))
        for number in numbers[np.argsort(first)]
    )
