"""The search for the best observer bandwidth: brackets of trials, and the vertex of a parabola through them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np


def adjacent(bandwidth: float) -> tuple[float, float]:
    """Twice and half of a bandwidth."""
    return 2.0 * bandwidth, 0.5 * bandwidth


def between(trials: Iterable[float], top: float, limit: float) -> bool:
    """Whether a trial lies between the best bandwidth `top` and a limit, the limit included."""
    low, high = sorted((top, limit))
    return any(low * 0.99 <= b <= high * 1.01 and abs(np.log(b / top)) > 0.03 for b in trials if b)


def parabola_top(scores: Mapping[float, float], top: float) -> float | None:
    """Vertex of a parabola in log(bandwidth) through the best trial and its two neighbours; None without a peak."""
    below, above = [b for b in scores if b < top], [b for b in scores if b > top]
    if top not in scores or not below or not above:
        return None
    points = np.array([max(below), top, min(above)])
    if not np.isfinite([scores[b] for b in points]).all():
        return None
    curvature, slope, _ = np.polyfit(np.log(points / top), [scores[b] - scores[top] for b in points], 2)
    return float(top * np.exp(-slope / (2.0 * curvature))) if curvature < 0.0 else None
