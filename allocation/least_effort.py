"""The closed form of the least-effort split for two drives."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allocation.bounds import SENSE, Bounds

Array = NDArray[np.float64]


def least_effort(
    bounds: Bounds, torque: ArrayLike, acceleration: ArrayLike = 0.0, weights: tuple[float, float] = (1.0, 1.0)
) -> Array:
    """Pinion torques of least weighted square sum for follower torques that can be reached.

    With xi = p + lambda v (equation 3) the effort sum w_i xi_i^2 is a parabola in lambda and every bound an interval,
    so the best lambda is the parabola's vertex clipped to [largest lower bound, least upper bound]:

        vertex = -(p' W v)/(v' W v),   (low_i - sigma_i p_i)/N_i <= lambda <= (max - sigma_i p_i)/N_i

    Args:
        bounds: on the pinion torques.
        torque: follower torque [N m], shape (...); moved to the nearest reachable one first.
        acceleration: load acceleration [rad/s^2], for the torque that the rotors take; broadcasts with `torque`.
        weights: w1, w2.

    Returns:
        Pinion torques [N m], shape (..., 2), inside the box to the last bit.
    """
    p, interval = preload_interval(bounds, torque, acceleration)
    v = bounds.gears.null_vector
    w = np.asarray(weights, dtype=np.float64)
    vertex = -(p @ (w * v)) / (v @ (w * v))
    preload = np.clip(vertex, interval[..., 0], interval[..., 1])
    return bounds.clip(p + preload[..., None] * v)


def preload_interval(bounds: Bounds, torque: ArrayLike, acceleration: ArrayLike = 0.0) -> tuple[Array, Array]:
    """Particular solution p (..., 2) [N m] and least and greatest admitted lambda (..., 2) [N m per tooth].

    The torque (...) is moved to the nearest reachable one first; at the edge of reach the interval is a point.
    """
    tau, a = np.broadcast_arrays(np.asarray(torque, dtype=np.float64), np.asarray(acceleration, dtype=np.float64))
    reach = bounds.reachable(a)
    p = bounds.gears.particular(np.clip(tau, reach[..., 0], reach[..., 1]))
    teeth = np.abs(bounds.gears.null_vector)
    low = np.minimum(bounds.lower(a), bounds.max_torque)
    least = np.max((low - SENSE * p) / teeth, axis=-1)
    greatest = np.min((bounds.max_torque - SENSE * p) / teeth, axis=-1)
    return p, np.stack((least, np.maximum(least, greatest)), axis=-1)
