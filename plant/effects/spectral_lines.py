"""Spectral lines over angle or time, as candidates for a periodic effect."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from plant.effects.motion import Array, Motion, Place
from plant.effects.recurrence import returns_to_its_states

_BY_POWER, _BY_MEASURE = 16, 12  # number of lines tried by power, and by power relative to white noise
_ROUNDED = 0.2  # weight of the isotropic part in the covariance of sine and cosine
_BETWEEN = (-0.25, -0.125, 0.125, 0.25)  # offsets, in resolvable lines
_EVEN = 1e-9  # rounding error of a place on an even grid
_LONGEST = 4000  # highest number of lines in a search
_RETURNS = 0.7  # mean phase agreement between visits to a state from which a wave counts as a function of the state


def lines_over_angle(motion: Motion, acts_on: Place = "torque") -> tuple[list[float], int]:
    """Orders [rad/rad] at which a ripple over the angle would improve the fit most, and the number compared.

    A period must take more than four samples at typical speed, or it is not resolved.
    """
    speed = float(np.quantile(np.abs(motion.velocity), 0.5))
    if speed <= 0.0:
        return [], 1
    highest = 2.0 * np.pi / (4.0 * speed * motion.sample_time)
    return strongest_lines(motion.angle, *motion.scores(acts_on), highest)


def lines_over_time(motion: Motion) -> tuple[list[float], int]:
    """Rates [rad/s] at which a wave in time would improve the fit most, unless the motion repeats with it.

    If the motion repeats at that rate, the wave cannot be distinguished from a function of angle and velocity.
    """
    highest = 2.0 * np.pi / (4.0 * motion.sample_time)
    rates, searched = strongest_lines(motion.time, *motion.scores("torque"), highest)
    return [
        rate for rate in rates if returns_to_its_states(motion, np.exp(1j * rate * motion.time)) <= _RETURNS
    ], searched


def closer(place: Array, rate: float) -> Array:
    """Rates around a given one, between the lines of the search: where a load rests, peaks may be that narrow."""
    apart = 2.0 * np.pi / max(float(np.ptp(place)), 1e-300)
    return np.asarray(rate + apart * np.array(_BETWEEN))


def waves(place: Array, rate: float) -> Array:
    """(T, 2) sine and cosine of `rate` [rad per unit] over a variable (T,)."""
    return np.column_stack((np.sin(rate * place), np.cos(rate * place)))


def as_wave(coefficients: Array) -> tuple[float, float]:
    """Amplitude and phase [rad] of the sine that is the sum of two `waves`."""
    return float(np.hypot(*coefficients)), float(np.arctan2(coefficients[1], coefficients[0]))


def eight_periods(place: Array) -> float:
    """Rate [rad per unit] of eight periods over the range of a variable (T,); 1 if the range is zero."""
    reach = float(np.ptp(place))
    return 16.0 * np.pi / reach if reach > 0.0 else 1.0


def strongest_lines(place: Array, scores: Array, chance: Array, highest: float) -> tuple[list[float], int]:
    """Frequencies over a variable (T,) at which a wave would improve a fit most, and the number compared.

    A line must complete two periods within the range, or it cannot be distinguished from a trend.

    If the innovations are white, a wave is judged by its power relative to that of white noise: the effect of a wave on
    the measurement depends on its frequency, its phase and the places where the load rests. If the model leaves more
    than noise, the absolute power is the better criterion. Some lines are tried by either criterion.

    Args:
        place: the variable.
        scores: (T, S) improvement of the fit by a torque at each sample, for each of S assumptions on the rest.
        chance: (T, M) the first of them for M draws of white noise in place of the innovations; M may be 0.
        highest: frequency [rad per unit].
    """
    reach = float(np.ptp(place))
    if reach <= 0.0:
        return [], 1
    apart = 2.0 * np.pi / reach
    highest = min(highest, _LONGEST * apart)
    if highest <= 2.0 * apart:
        return [], 1
    frequencies = apart * np.arange(8.0, np.floor(4.0 * highest / apart * (1.0 + _EVEN)) + 1.0) / 4.0
    drawn = _sines_and_cosines(place, (*scores.T, *chance.T), frequencies)
    seen, white = drawn[: scores.shape[1]], drawn[scores.shape[1] :]
    heights = [(np.sum(each**2, axis=0), _BY_POWER // len(seen)) for each in seen]
    if white:
        heights.append((_explained(seen[0], np.array(white)), _BY_MEASURE))
    chosen: list[float] = []
    for height, count in heights:
        found = 0
        for index in np.argsort(height)[::-1]:
            if all(abs(frequencies[index] - other) > apart for other in chosen):
                chosen.append(float(frequencies[index]))
                found += 1
            if found == count:
                break
    return chosen, frequencies.size


def _explained(seen: Array, white: Array) -> Array:
    """(F,) power of sines and cosines with scores (2, F), relative to that of white noise (M, 2, F), up to a factor.

    The covariance of few draws is blended with an isotropic one, or it would be narrow somewhere by chance alone.
    """
    covariance = np.einsum("maf,mbf->fab", white, white)
    size = 0.5 * np.trace(covariance, axis1=1, axis2=2)[:, None, None]
    round_ = (1.0 - _ROUNDED) * covariance + (_ROUNDED * size + 1e-300) * np.eye(2)
    return np.asarray(np.einsum("af,fab,bf->f", seen, np.linalg.inv(round_), seen))


def _sines_and_cosines(place: Array, scores: Iterable[Array], frequencies: Array) -> list[Array]:
    """(2, F) sums of each score (T,) times sine and cosine over `place`, by fine binning."""
    from scipy.fft import next_fast_len, rfft

    step = 2.0 * np.pi / frequencies[-1] / 6.0
    bins = np.floor((place - place.min()) / step + _EVEN).astype(int)
    length = next_fast_len(8 * int(bins.max() + 1), real=True)
    nearest = np.minimum(np.rint(frequencies * length * step / (2.0 * np.pi)).astype(int), length // 2)
    spectra = (rfft(np.bincount(bins, weights=score), length)[nearest] for score in scores)
    return [np.stack((spectrum.real, spectrum.imag)) for spectrum in spectra]
