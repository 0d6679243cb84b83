"""Test signals: what to play into a servo to learn its parameters."""

from __future__ import annotations

import numpy as np

from plant.effects.effect import Array
from plant.errors import BadParameter


def chirp(*, amplitude: float, start: float, stop: float, duration: float, sample_time: float) -> Array:
    """(T,) sine whose frequency grows linearly from `start` to `stop` [Hz] over `duration` [s]."""
    _check(duration, sample_time)
    t = np.arange(round(duration / sample_time)) * sample_time
    return amplitude * np.sin(2.0 * np.pi * (start * t + 0.5 * (stop - start) / duration * t**2))


def steps(*, levels: tuple[float, ...], hold: float, sample_time: float) -> Array:
    """(T,) constant levels, each held for `hold` [s]."""
    _check(hold, sample_time)
    return np.repeat(np.asarray(levels, dtype=float), round(hold / sample_time))


def multisine(
    *, amplitude: float, frequencies: tuple[float, ...], duration: float, sample_time: float, seed: int = 0
) -> Array:
    """(T,) sum of sines [Hz] with seeded random phases, scaled to a peak of `amplitude`."""
    _check(duration, sample_time)
    t = np.arange(round(duration / sample_time)) * sample_time
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(frequencies))
    waves = np.sin(2.0 * np.pi * np.outer(t, frequencies) + phases).sum(axis=1)
    return np.asarray(amplitude * waves / np.max(np.abs(waves)), dtype=float)


def _check(duration: float, sample_time: float) -> None:
    if not 0.0 < sample_time < duration:
        raise BadParameter(f"sample_time = {sample_time:g} s must be positive and below the duration {duration:g} s.")
