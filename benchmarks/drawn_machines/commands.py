"""Commands of a servo: six kinds, as signals of unit amplitude over the samples.

frequency: highest relevant frequency of the motion times the sample time [-]; all signals scale with it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]
Shape = Callable[[np.random.Generator, int, float], Array]


def chirp(rng: np.random.Generator, n: int, frequency: float) -> Array:
    """One to four sweeps, up or down."""
    sweeps = int(rng.integers(1, 5))
    low, high = max(frequency * rng.uniform(0.05, 0.3), 2.0 * sweeps / n), frequency * rng.uniform(1.0, 2.5)
    along = (np.arange(n) * sweeps / n) % 1.0
    along = 1.0 - along if rng.random() < 0.3 else along
    rate = low * (high / low) ** along
    return np.sin(2.0 * np.pi * np.cumsum(rate))


def multisine(rng: np.random.Generator, n: int, frequency: float) -> Array:
    """Six to twenty tones of random phase."""
    tones = int(rng.integers(6, 21))
    rates = np.exp(rng.uniform(np.log(max(0.05 * frequency, 2.0 / n)), np.log(2.0 * frequency), tones))
    phases = rng.uniform(0.0, 2.0 * np.pi, tones)
    wave = np.sin(2.0 * np.pi * np.outer(np.arange(n), rates) + phases) @ rng.uniform(0.3, 1.0, tones)
    return np.asarray(wave / np.abs(wave).max())


def binary(rng: np.random.Generator, n: int, frequency: float) -> Array:
    """A pseudo-random binary signal."""
    hold = max(1, round(0.25 / frequency))
    return np.repeat(rng.choice([-1.0, 1.0], n // hold + 1), hold)[:n]


def staircase(rng: np.random.Generator, n: int, frequency: float) -> Array:
    """Held levels, up and down in order or at random."""
    hold = max(5, min(round(rng.uniform(1.0, 5.0) / frequency), n // 8))
    count = n // hold + 1
    if rng.random() < 0.5:
        steps = int(rng.integers(3, 9))
        ladder = np.concatenate((np.arange(-steps, steps), np.arange(steps, -steps, -1))) / steps
        levels = np.resize(np.roll(ladder, -steps), count)
    else:
        levels = rng.uniform(-1.0, 1.0, count)
    return np.repeat(levels, hold)[:n]


def moves(rng: np.random.Generator, n: int, frequency: float) -> Array:
    """Smooth point-to-point moves with a rest after each."""
    pieces: list[Array] = [np.zeros(max(2, round(0.2 / frequency)))]
    here, length = 0.0, pieces[0].size
    while length < n:
        there = rng.uniform(-1.0, 1.0)
        s = np.linspace(0.0, 1.0, max(6, round(rng.uniform(0.5, 1.5) * (0.3 + abs(there - here)) / frequency)))
        way = here + (there - here) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        pieces += [way, np.full(round(rng.uniform(0.1, 1.0) / frequency), there)]
        length, here = length + pieces[-1].size + pieces[-2].size, there
    return np.concatenate(pieces)[:n]


def slow(rng: np.random.Generator, n: int, frequency: float) -> Array:
    """Slow triangles, or held speeds that change: with stick and slip."""
    half = min(round(rng.uniform(2.0, 8.0) / frequency), n // 6)
    if rng.random() < 0.5:
        return np.abs((np.arange(n) / half + 1.5) % 2.0 - 1.0) * 2.0 - 1.0
    count = n // half + 1
    speeds = rng.uniform(0.1, 1.0, count) * np.where(np.arange(count) % 2, -1.0, 1.0)
    way = np.cumsum(np.repeat(speeds, half)[:n])
    way = way - np.linspace(0.0, way[-1], n)
    return way / np.abs(way).max()


KINDS: dict[str, Shape] = {
    "chirp": chirp,
    "multisine": multisine,
    "binary": binary,
    "staircase": staircase,
    "moves": moves,
    "slow": slow,
}


def smoothed(wave: Array, frequency: float) -> Array:
    """A reference that a loop can follow: steps take a quarter of the shortest period."""
    decay = float(np.exp(-2.0 * np.pi * 2.0 * frequency))
    once, _ = lfilter([1.0 - decay], [1.0, -decay], wave, zi=[decay * wave[0]])
    twice, _ = lfilter([1.0 - decay], [1.0, -decay], once, zi=[decay * once[0]])
    return np.asarray(twice)


def pushes(rng: np.random.Generator, n: int, frequency: float) -> Array:
    """The torque of moves without a loop: accelerate, brake, rest."""
    pieces: list[Array] = []
    length = 0
    while length < n:
        half, rest = (max(2, round(rng.uniform(0.2, 0.8) / frequency)) for _ in range(2))
        push = np.sin(np.linspace(0.0, np.pi, half)) * rng.uniform(0.3, 1.0) * rng.choice([-1.0, 1.0])
        pieces += [push, -push, np.zeros(rest)]
        length += 2 * half + rest
    return np.concatenate(pieces)[:n]
