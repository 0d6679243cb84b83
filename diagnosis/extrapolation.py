"""Whether validation data lie outside the range of the estimation log: an error there says nothing about a cause."""

from __future__ import annotations

import numpy as np

from identification.log import Log
from plant.effects.effect import Array

_MARGIN = 0.05  # of the range of the estimation log, by which validation data may exceed it
_MUCH = 0.1  # share of the validation data that may exceed it by more


def extrapolation_warning(held_out: Log, seen: Log) -> str | None:
    """A sentence if many validation samples lie at angles, or speeds, outside the range of the estimation log."""
    angle, unit = ("positions", "m") if seen.axis == "linear" else ("angles", "rad")
    ranges = [("speeds", _speeds, f"{unit}/s")]
    if seen.response != "velocity":
        ranges.insert(0, (angle, _angles, unit))
    for name, of, size in ranges:
        known, needed = of(seen), of(held_out)
        low, high = float(known.min()), float(known.max())
        margin = _MARGIN * (high - low)
        outside = float(np.mean((needed < low - margin) | (needed > high + margin)))
        if outside > _MUCH:
            return (
                f"{100.0 * outside:.0f} % of the validation data have {name} outside {low:.3g} to {high:.3g} {size}, "
                "the range of the estimation log. Record a log that covers this range."
            )
    return None


def _angles(log: Log) -> Array:
    """(T,) angles of all valid samples."""
    return np.concatenate([run.output[run.valid] for run in log.runs])


def _speeds(log: Log) -> Array:
    """(T,) speeds by differences; noise makes their range wider."""
    return np.concatenate([np.gradient(run.output[run.valid], run.time[run.valid]) for run in log.runs])
