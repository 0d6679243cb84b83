"""Standard errors of statistics of a record, by the jackknife over blocks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from plant.effects.effect import Array

BLOCKS = 20
"""Number of blocks of a record; each must be longer than the correlation time of the errors."""


def jackknife(statistic: Callable[..., float], *records: Array) -> float:
    """Standard error of a function of the means of records, by the jackknife over blocks (Kuensch 1989).

    Unlike formulas for independent samples it holds for errors that are correlated over many samples, as in simulation.

    Args:
        statistic: function of the mean of each record; for a root mean square the root, with the squares as record.
        records: (T,) each, of the same samples.

    Returns:
        sqrt((B - 1) / B * sum of (statistic without block b - their mean)^2); 0 for a single sample.
    """
    count = min(BLOCKS, records[0].size)
    if count < 2:
        return 0.0
    means = np.array([[block.mean() for block in np.array_split(record, count)] for record in records])
    without = (means.sum(axis=1, keepdims=True) - means) / (count - 1)
    values = np.array([statistic(*left) for left in without.T])
    return float(np.sqrt((count - 1) * np.mean((values - values.mean()) ** 2)))
