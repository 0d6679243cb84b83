"""The closed form of the least-effort allocation for two drives on one joint."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allocation.limits import Limits, PerDrive, per_drive
from plant.errors import BadParameter

Array = NDArray[np.float64]


def least_effort(bounds: Limits, torque: ArrayLike, acceleration: ArrayLike = 0.0, weights: PerDrive = 1.0) -> Array:
    """Torques of two drives with the least weighted sum of squares, for given torques on their joint.

    Args:
        bounds: of two drives on one joint: a gear train, or another structure.
        torque: on the joint (output gear) [N m], shape (...); replaced by the nearest reachable one.
        acceleration: of the joint [rad/s^2], for the torque of the rotor inertia; broadcasts with `torque`.
        weights: w1, w2.

    Returns:
        Pinion torques [N m], shape (..., 2), inside the bounds to the last bit.

    Raises:
        BadParameter: not two drives on one joint.
    """
    if bounds.structure.matrix.shape != (1, 2):
        raise BadParameter("The closed form is for two drives on one joint; use `Allocator` for others.")
    tau, a = np.broadcast_arrays(np.asarray(torque, dtype=np.float64), np.asarray(acceleration, dtype=np.float64))
    low = np.minimum(bounds.lower(a), bounds.greatest)
    high = np.broadcast_to(bounds.greatest, low.shape)
    shared = share_between_two(bounds.structure.pushing[0], tau, low, high, per_drive("weights", weights, 2))
    return np.asarray(bounds.structure.signs * shared)


def share_between_two(
    pushing: Array, torque: Array, lower: Array, upper: Array, weights: Array, preload: Array | None = None
) -> Array:
    """Minimise sum w_i x_i^2 subject to b x = tau (b1, b2 of opposite sign) and lower <= x <= upper, in closed form.

    With the unit vectors u along the null space and e = b/|b| normal to it, x = c u + tau/|b| e (equation 3, c is the
    preload). The effort is a parabola in c and each bound is an interval of c, so the best c is the vertex of the
    parabola clipped to [largest lower bound, smallest upper bound]:

        vertex = -tau/|b| (e' W u)/(u' W u),   (lower_i - tau/|b| e_i)/u_i <= c <= (upper_i - tau/|b| e_i)/u_i

    A torque out of reach is replaced by the nearest reachable one. The greatest reachable torque lies at a corner of
    the box of bounds, or where an edge of the box meets the limit of c.

    Args:
        pushing: (2,) b, torque on the joint for one newton metre of each drive in its direction.
        torque: (...) tau [N m].
        lower, upper: (..., 2) bounds on x [N m]; lower <= upper.
        weights: (2,) w.
        preload: (..., 2) least and greatest c [N m]; the c of `lower` must lie between them. None: no limit.

    Returns:
        (..., 2) x [N m], inside the bounds to the last bit.
    """
    size = np.linalg.norm(pushing)
    across, along = pushing / size, np.abs(pushing[::-1]) / size
    limits = np.array([-np.inf, np.inf]) if preload is None else preload
    to_least = np.where(across > 0, lower, upper)
    to_greatest = np.where(across > 0, upper, lower)
    least, greatest = (
        sign * np.min(sign * (corner - _clip(corner @ along, limits)[..., None] * along) / across, axis=-1)
        for sign, corner in ((-1.0, to_least), (1.0, to_greatest))
    )
    t = np.clip(torque / size, least, greatest)[..., None] * across
    vertex = -(t @ (weights * along)) / (along @ (weights * along))
    from_box = np.stack((np.max((lower - t) / along, axis=-1), np.min((upper - t) / along, axis=-1)), axis=-1)
    c = np.clip(vertex, np.maximum(from_box[..., 0], limits[..., 0]), np.minimum(from_box[..., 1], limits[..., 1]))
    return settled(c[..., None] * along + t, lower, upper)


def settled(x: Array, lower: Array, upper: Array) -> Array:
    """x clipped to its bounds, and set exactly on a bound if it differs from it by rounding only."""
    rounding = 8 * np.finfo(float).eps * np.maximum(np.abs(lower), np.abs(upper))
    x = np.where(x <= lower + rounding, lower, x)
    return np.where(x >= upper - rounding, upper, x)


def _clip(c: Array, limits: Array) -> Array:
    return np.asarray(np.clip(c, limits[..., 0], limits[..., 1]))
