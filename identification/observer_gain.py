"""Gains of the stationary Kalman filter for a random load torque, in closed form.

If the angle is measured it is the alpha-beta filter (Kalata 1984), if the velocity is measured a scalar filter. Each
has one parameter, the observer bandwidth.
"""

from __future__ import annotations

import numpy as np

from identification.run import Run
from plant.effects.effect import Array

_DIGITS = 9  # significant digits of a time step: the others are rounding of the clock


def observer_gain(bandwidth: float, dt: Array) -> Array:
    """(2, T) gain on angle [-] and velocity [1/s] of the alpha-beta filter (Kalata 1984, eqs. for the tracking index).

    Args:
        bandwidth: square root of acceleration noise [rad/s^2] over measurement noise [rad]: [rad/s].
        dt: (T,) time step of each sample [s].
    """
    # sample by sample: a run in pieces has the same gains as the whole run
    dt = np.round(dt, _DIGITS - int(np.floor(np.log10(np.median(dt)))))
    steps = dt[:1] if (dt == dt[0]).all() else dt
    index = (bandwidth * steps) ** 2
    r = (4.0 + index - np.sqrt(8.0 * index + index**2)) / 4.0
    alpha = 1.0 - r**2
    beta = 2.0 * (2.0 - alpha) - 4.0 * np.sqrt(1.0 - alpha)
    gains = np.stack((alpha, beta / np.maximum(steps, 1e-15)))
    return np.repeat(gains, dt.size, axis=1) if steps.size < dt.size else gains


def speed_gain(bandwidth: float, dt: Array) -> Array:
    """(2, T) gains as in `observer_gain` if the velocity is measured; the gain on the angle is zero.

    Args:
        bandwidth: square root of acceleration noise [rad/s^2] over measurement noise [rad/s]: [1/s].
        dt: (T,) time step of each sample [s].
    """
    index = bandwidth * dt  # scalar Kalman filter of a random-walk velocity, in closed form
    return np.stack((np.zeros(dt.size), 0.5 * index * (np.sqrt(index**2 + 4.0) - index)))


def correcting_gain(run: Run, bandwidth: float, dt: Array) -> Array:
    """(2, T) gains on angle and velocity for the measured quantity of a run."""
    gain = speed_gain if run.response == "velocity" else observer_gain
    return gain(bandwidth, dt)
