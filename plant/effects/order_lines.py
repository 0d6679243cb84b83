"""Lines in a spectrum over angle or time, where a periodic cause would show."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter

from plant.effects.motion import Array, Motion
from plant.effects.returns import returning

_NEIGHBOURHOOD = 101  # grid points, a quarter of a resolvable line each, whose median is the background of a peak
_BESIDE = 16  # lines on each side of one by which it is told what chance, or a poor model, makes there
_LONGEST = 4000  # lines that a search may reach
_RETURNS = 0.7  # mean agreement of a wave's phases between visits to a state, from which it is taken for the state's


def lines_over_angle(motion: Motion, score: Array) -> tuple[list[float], int]:
    """Orders [rad/rad] at which a ripple over the angle would improve the fit most, and how many were looked at.

    A period must take more than four samples at typical speed, or it is not resolved.
    """
    speed = float(np.quantile(np.abs(motion.velocity), 0.5))
    if speed <= 0.0:
        return [], 1
    return strongest_lines(motion.angle, score, 2.0 * np.pi / (4.0 * speed * motion.sample_time))


def lines_over_time(motion: Motion) -> tuple[list[float], int]:
    """Rates [rad/s] at which a wave in time would improve the fit most, if the motion does not repeat in them.

    Of a repeated motion, a wave that comes back with it is any torque that depends on angle and velocity.
    """
    rates, searched = strongest_lines(motion.time, motion.score, 2.0 * np.pi / (4.0 * motion.sample_time))
    return [rate for rate in rates if returning(motion, np.exp(1j * rate * motion.time)) <= _RETURNS], searched


def neighbouring(place: Array, rate: float) -> Array:
    """Rates beside one, as far apart as lines can be told apart over a variable (T,), on both sides.

    None outside what a search looks at: of a rate to which a fit has run off there is no telling.
    """
    apart = 2.0 * np.pi / max(float(np.ptp(place)), 1e-300)
    steps = np.arange(2.0, 2.0 + _BESIDE)
    rates = rate + apart * np.concatenate((-steps[::-1], steps))
    return np.asarray(rates[(rates >= 2.0 * apart) & (rates <= _LONGEST * apart)])


def waves(place: Array, rate: float) -> Array:
    """(T, 2) sine and cosine of `rate` [rad per unit] over a variable (T,)."""
    return np.column_stack((np.sin(rate * place), np.cos(rate * place)))


def as_wave(coefficients: Array) -> tuple[float, float]:
    """Amplitude and phase [rad] of a sine that sums two `waves`."""
    return float(np.hypot(*coefficients)), float(np.arctan2(coefficients[1], coefficients[0]))


def eight_periods(place: Array) -> float:
    """Rate [rad per unit] of eight periods over the range of a variable (T,); 1 where it has none."""
    reach = float(np.ptp(place))
    return 16.0 * np.pi / reach if reach > 0.0 else 1.0


def strongest_lines(place: Array, score: Array, highest: float) -> tuple[list[float], int]:
    """Peaks of the periodogram of a score (T,) over a variable (T,), and the number of frequencies looked at.

    A line must complete two periods within the range, or it cannot be told from a trend.
    """
    reach = float(np.ptp(place))
    if reach <= 0.0:
        return [], 1
    apart = 2.0 * np.pi / reach
    highest = min(highest, _LONGEST * apart)
    if highest <= 2.0 * apart:
        return [], 1
    frequencies = np.arange(2.0 * apart, highest, apart / 4.0)
    power = _periodogram(place, score, frequencies)
    # A slow torque moves the load further than a fast one, so the background falls with the frequency: a line may stand
    # out of it without being among the highest. Of the highest more are tried, for some are only drift.
    background = np.maximum(median_filter(power, size=_NEIGHBOURHOOD, mode="nearest"), 1e-300)
    chosen: list[float] = []
    for height, count in ((power, 16), (power / background, 6)):
        found = 0
        for index in np.argsort(height)[::-1]:
            if all(abs(frequencies[index] - other) > apart for other in chosen):
                chosen.append(float(frequencies[index]))
                found += 1
            if found == count:
                break
    return chosen, frequencies.size


def _periodogram(place: Array, values: Array, frequencies: Array) -> Array:
    """Power of `values` at each frequency over `place`, by binning it finely and transforming the bins."""
    step = 2.0 * np.pi / frequencies[-1] / 6.0
    bins = np.floor((place - place.min()) / step).astype(int)
    sums = np.bincount(bins, weights=values)
    length = int(2 ** np.ceil(np.log2(8 * sums.size)))
    spectrum = np.abs(np.fft.rfft(sums, length)) ** 2
    return np.asarray(np.interp(frequencies, 2.0 * np.pi * np.fft.rfftfreq(length, step), spectrum), dtype=float)
