"""Gains of the stationary Kalman filter for a random load torque, in closed form.

If the angle is measured it is the alpha-beta filter (Kalata 1984), if the velocity is measured a scalar filter. Each
has one parameter, the observer bandwidth.
"""

from __future__ import annotations

import numpy as np

from identification.run import Run
from plant.effects.effect import Array

_DIGITS = 9  # significant digits of a time step: the others are rounding of the clock


def observer_gain(bandwidth: float, dt: Array, *, random_walk: bool = False) -> Array:
    """(2, T) gain on angle [-] and velocity [1/s] of the alpha-beta filter (Kalata 1984, eqs. for the tracking index).

    Args:
        bandwidth: square root of acceleration noise [rad/s^2] over measurement noise [rad]: [rad/s].
        dt: (T,) time step of each sample [s].
        random_walk: the acceleration is a random walk instead, as in the alpha-beta-gamma filter; then (3, T), with the
            gain on the acceleration [1/s^2].
    """
    # sample by sample: a run in pieces has the same gains as the whole run
    dt = np.round(dt, _DIGITS - int(np.floor(np.log10(np.median(dt)))))
    steps = dt[:1] if (dt == dt[0]).all() else dt
    gains = _third_order_gain(bandwidth, steps) if random_walk else _second_order_gain(bandwidth, steps)
    return np.repeat(gains, dt.size, axis=1) if steps.size < dt.size else gains


def _second_order_gain(bandwidth: float, dt: Array) -> Array:
    index = (bandwidth * dt) ** 2
    r = (4.0 + index - np.sqrt(8.0 * index + index**2)) / 4.0
    alpha = 1.0 - r**2
    beta = 2.0 * (2.0 - alpha) - 4.0 * np.sqrt(1.0 - alpha)
    return np.stack((alpha, beta / np.maximum(dt, 1e-15)))


def _third_order_gain(bandwidth: float, dt: Array) -> Array:
    """Gray and Murray (1993): alpha = 1 - s^2 with 2 (1 - s)^3 = index s (1 + s), by bisection."""
    steps, place = np.unique(dt, return_inverse=True)
    index, low, high = (bandwidth * steps) ** 3, np.zeros(steps.size), np.ones(steps.size)
    for _ in range(50):
        s = 0.5 * (low + high)
        above = 2.0 * (1.0 - s) ** 3 > index * s * (1.0 + s)
        low, high = np.where(above, s, low), np.where(above, high, s)
    s = high  # one where the bandwidth is zero
    alpha, beta = 1.0 - s**2, 2.0 * (1.0 - s) ** 2
    gamma = beta**2 / np.maximum(2.0 * alpha, 1e-300)
    least = np.maximum(steps, 1e-15)
    return np.asarray(np.stack((alpha, beta / least, gamma / least**2))[:, place])


def speed_gain(bandwidth: float, dt: Array, *, random_walk: bool = False) -> Array:
    """(2, T) gains as in `observer_gain` if the velocity is measured; the gain on the angle is zero.

    Args:
        bandwidth: square root of acceleration noise [rad/s^2] over measurement noise [rad/s]: [1/s].
        dt: (T,) time step of each sample [s].
        random_walk: the acceleration is a random walk instead; then (3, T) with the gain on the acceleration [1/s].
    """
    nothing = np.zeros((1, dt.size))
    if random_walk:
        return np.vstack((nothing, observer_gain(bandwidth, dt)))
    index = bandwidth * dt  # scalar Kalman filter of a random-walk velocity, in closed form
    return np.vstack((nothing, 0.5 * index * (np.sqrt(index**2 + 4.0) - index)))


def correcting_gain(run: Run, bandwidth: float, dt: Array, *, random_walk: bool = False) -> Array:
    """(2, T) or (3, T) gains on angle, velocity and acceleration for the measured quantity of a run."""
    gain = speed_gain if run.response == "velocity" else observer_gain
    return gain(bandwidth, dt, random_walk=random_walk)
