"""Test signals for identification: chirp, steps, triangle, multisine."""

from __future__ import annotations

from collections.abc import Callable

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


def pseudo_random_binary(*, amplitude: float, hold: float, duration: float, sample_time: float, seed: int = 0) -> Array:
    """(T,) plus or minus `amplitude`, randomly drawn every `hold` [s]: white up to about half of 1/hold [Hz]."""
    rng = np.random.default_rng(seed)
    return _held(lambda count: amplitude * rng.choice((-1.0, 1.0), count), hold, duration, sample_time)


def random_levels(*, amplitude: float, hold: float, duration: float, sample_time: float, seed: int = 0) -> Array:
    """(T,) levels of alternating sign and random size up to `amplitude`, each held for `hold` [s]."""
    rng = np.random.default_rng(seed)

    def levels(count: int) -> Array:
        sizes = rng.uniform(0.2, 1.0, count)
        return np.asarray(amplitude * np.where(np.arange(count) % 2, -sizes, sizes) / sizes.max())

    return _held(levels, hold, duration, sample_time)


def plateaus(*, amplitude: float, hold: float, duration: float, sample_time: float) -> Array:
    """(T,) a staircase of quarters of `amplitude`, up and down through both signs, a step every `hold` [s].

    On a machine with viscous friction each level settles at its own speed.
    """
    cycle = np.array([1, 2, 3, 4, 3, 2, 1, 0, -1, -2, -3, -4, -3, -2, -1, 0]) / 4.0
    return _held(lambda count: amplitude * np.resize(cycle, count), hold, duration, sample_time)


def pulses(*, amplitude: float, width: float, rest: float, duration: float, sample_time: float) -> Array:
    """(T,) pulses of alternating sign, `width` long and `rest` apart [s], with no torque between them."""
    t = _time(duration, sample_time)
    number, phase = np.divmod(t, width + rest)
    return np.asarray(amplitude * np.where(phase < width, np.where(number % 2, -1.0, 1.0), 0.0))


def triangle(*, amplitude: float, frequency: float, duration: float, sample_time: float) -> Array:
    """(T,) a triangular wave that begins at zero and rises."""
    wave = np.arcsin(np.sin(2.0 * np.pi * frequency * _time(duration, sample_time)))
    return np.asarray(amplitude * 2.0 / np.pi * wave)


def growing_sine(*, amplitude: float, frequency: float, duration: float, sample_time: float) -> Array:
    """(T,) a sine whose amplitude grows linearly from zero to `amplitude`."""
    t = _time(duration, sample_time)
    return np.asarray(amplitude * t / t[-1] * np.sin(2.0 * np.pi * frequency * t))


def _held(draw: Callable[[int], Array], hold: float, duration: float, sample_time: float) -> Array:
    """(T,) levels, as many as the duration takes, each held for `hold` [s]."""
    t = _time(duration, sample_time)
    place = np.floor(t / max(hold, sample_time) + 1e-9).astype(int)
    return np.asarray(draw(int(place[-1]) + 1)[place], dtype=float)


def _time(duration: float, sample_time: float) -> Array:
    _check(duration, sample_time)
    return np.arange(round(duration / sample_time), dtype=float) * sample_time


def _check(duration: float, sample_time: float) -> None:
    if not 0.0 < sample_time < duration:
        raise BadParameter(f"sample_time = {sample_time:g} s must be positive and below the duration {duration:g} s.")
