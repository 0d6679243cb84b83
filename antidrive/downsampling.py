"""Fewer points for a drawing, without losing a spike."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

LIMIT = 2000  # points of one drawn curve


def downsample(y: NDArray[np.float64], limit: int = LIMIT) -> NDArray[np.intp]:
    """Indices (P,) of the samples to draw of a curve (T,): the ends, and minimum and maximum of each section.

    A section that is all NaN keeps one NaN, so that the drawn line breaks there.
    """
    size = y.size
    if size <= limit:
        return np.arange(size)
    stretches = limit // 2 - 1
    kept = [np.array([0, size - 1])]
    edges = np.linspace(0, size, stretches + 1).astype(int)
    for first, last in pairwise(edges):
        piece = y[first:last]
        if np.isnan(piece).all():
            kept.append(np.array([first]))
        else:
            kept.append(first + np.array([np.nanargmin(piece), np.nanargmax(piece)]))
    return np.unique(np.concatenate(kept))
