"""What is played into the machines: chirps, steps, a reference to follow, a load that fluctuates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def excitation(seed: int, *, duration: float = 60.0, sample_time: float = 0.005, scale: float = 1.0) -> Array:
    """(T,) a slow chirp, steps, a fast chirp, small steps: a quarter of the time each, sizes drawn from the seed."""
    rng = np.random.default_rng([seed, 1])
    quarter = duration / 4
    parts = [
        chirp(rng.uniform(4.0, 6.0), 0.05, rng.uniform(0.5, 0.8), quarter, sample_time),
        random_steps(rng, 2.0, 8.0, quarter, sample_time),
        chirp(rng.uniform(6.0, 9.0), 0.5, rng.uniform(4.0, 6.0), quarter, sample_time),
        random_steps(rng, 0.7, 1.8, quarter, sample_time),
    ]
    return scale * np.concatenate(parts)


def chirp_and_steps(seed: int, *, duration: float = 60.0, sample_time: float = 0.005) -> Array:
    """(T,) one chirp and a few steps: the least that should do for the four parameters."""
    rng = np.random.default_rng([seed, 2])
    half = duration / 2
    sweep = chirp(rng.uniform(4.0, 7.0), 0.05, 1.0, half, sample_time)
    return np.concatenate((sweep, random_steps(rng, 1.0, 6.0, half, sample_time)))


def chirp(amplitude: float, start: float, stop: float, duration: float, sample_time: float) -> Array:
    t = np.arange(round(duration / sample_time)) * sample_time
    return amplitude * np.sin(2 * np.pi * (start * t + (stop - start) * t**2 / (2 * duration)))


def random_steps(rng: np.random.Generator, least: float, most: float, duration: float, sample_time: float) -> Array:
    """(T,) levels of alternating sign with a size between `least` and `most`, each held for 0.5 to 2 s."""
    count = round(duration / sample_time)
    levels: list[Array] = []
    sign = 1.0
    while sum(map(len, levels)) < count:
        hold = round(rng.uniform(0.5, 2.0) / sample_time)
        levels.append(np.full(hold, sign * rng.uniform(least, most)))
        sign = -sign
    return np.concatenate(levels)[:count]


def wandering_reference(seed: int, *, duration: float = 60.0, sample_time: float = 0.005) -> Array:
    """(T,) smooth moves between random angles [rad], for closed loops."""
    rng = np.random.default_rng([seed, 3])
    t = np.arange(round(duration / sample_time)) * sample_time
    tones = rng.uniform(0.03, 0.3, 6)
    waves = np.sin(2 * np.pi * np.outer(t, tones) + rng.uniform(0, 2 * np.pi, 6)) @ (1.0 / (1.0 + 3.0 * tones))
    plateaus = np.repeat(rng.uniform(-1.5, 1.5, t.size // 600 + 1), 600)[: t.size]
    return np.asarray(waves + plateaus)


def load_fluctuation(
    seed: int, rms: float, shape: tuple[int, int], *, correlation_time: float = 0.02, sample_time: float = 0.005
) -> Array:
    """(T, B) load torque that fluctuates at random (Ornstein-Uhlenbeck) with a given rms [N m]."""
    rng = np.random.default_rng([seed, 4])
    keep = np.exp(-sample_time / correlation_time)
    kicks = rms * np.sqrt(1 - keep**2) * rng.standard_normal(shape)
    kicks[0] = rms * rng.standard_normal(shape[1])
    path = np.empty(shape)
    path[0] = kicks[0]
    for k in range(1, shape[0]):
        path[k] = keep * path[k - 1] + kicks[k]
    return path
