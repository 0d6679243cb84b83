"""Moving targets for a camera: reference angles that start at rest at angle zero, within a span and an acceleration."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.signal import lfilter

from antidrive.experiments.outcome import Array

FADE_IN = 1.5
"""Time over which a target fades in from rest [s]; errors count after it."""

HOLD, MOVE = 2.5, 1.6
"""Period of a stepping target, and the part of it in which it moves [s]."""

WALK_BAND = 0.2
"""Cut-off frequency of the low pass that makes a random walk smooth enough to follow [Hz]."""


def _smooth(time: Array, rng: np.random.Generator) -> Array:
    """Three sines of random phase, with many reversals."""
    sines = zip((1.0, 0.5, 0.25), (0.1, 0.2, 0.4), rng.uniform(0.0, 2.0 * np.pi, 3), strict=True)
    waves = [a * np.sin(2.0 * np.pi * f * time + phase) for a, f, phase in sines]
    return np.asarray(np.sum(waves, axis=0) * _risen(time))


def _stepping(time: Array, rng: np.random.Generator) -> Array:
    """Minimum-jerk moves between random levels, each with a rest."""
    levels = np.append(0.0, rng.uniform(-1.0, 1.0, int(time[-1] / HOLD) + 2))
    place = (time / HOLD).astype(int)
    share = np.clip((time - place * HOLD) / MOVE, 0.0, 1.0)
    return np.asarray(levels[place] + (levels[place + 1] - levels[place]) * least_jerk(share))


def _walking(time: Array, rng: np.random.Generator) -> Array:
    """White noise through three equal lags: a random walk over short times, bounded over long ones."""
    lead = round(3.0 / (WALK_BAND * time[1]))  # until the initial transient of the lags has decayed
    pole = np.exp(-2.0 * np.pi * WALK_BAND * time[1])
    walk = rng.standard_normal(lead + time.size)
    for _ in range(3):
        walk = lfilter([1.0 - pole], [1.0, -pole], walk)
    return np.asarray(walk[lead:] * _risen(time))


TARGETS: dict[str, Callable[[Array, np.random.Generator], Array]] = {
    "smooth": _smooth,
    "stepping": _stepping,
    "random walk": _walking,
}


def target(kind: str, time: Array, seed: int, *, span: float, acceleration: float) -> Array:
    """(T,) angle of a target [rad], as large as span and acceleration allow.

    Args:
        kind: one of `TARGETS`.
        time: (T,) equally spaced from zero [s].
        seed: of phases, levels or noise.
        span: the angle stays within half of it on either side [rad].
        acceleration: greatest one [rad/s^2].
    """
    path = TARGETS[kind](time, np.random.default_rng(seed))
    fastest = np.max(np.abs(np.diff(path, 2))) / time[1] ** 2
    return np.asarray(path * min(0.5 * span / np.max(np.abs(path)), acceleration / fastest))


def least_jerk(share: Array) -> Array:
    """Minimum-jerk course from 0 to 1 over a fraction of the duration, at rest at both ends (Flash and Hogan 1985)."""
    return np.asarray(share**3 * (10.0 - 15.0 * share + 6.0 * share**2))


def _risen(time: Array) -> Array:
    return least_jerk(np.clip(time / FADE_IN, 0.0, 1.0))
