"""Capability map of two drives without loss of contact: least preload, margin and copper-loss index."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allocation.allocator import Allocator
from allocation.least_effort import least_effort
from plant.errors import BadParameter
from plant.result_display import Drawn

Array = NDArray[np.float64]

_ROUNDING = 1e-12
"""A smaller margin is taken as zero, in units of the greatest torque."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CapabilityMap(Drawn):
    """Preload, margin and copper loss to move a load without loss of contact, over P accelerations and Q load torques.

    Attributes:
        acceleration: (P,) of the load [rad/s^2], rising.
        load_torque: (Q,) of the load without acceleration: gravity, friction, process [N m], rising.
        least_preload: (P, Q) lambda of the least-effort torques that keep contact [N m per tooth], see
            `Allocation.preload`; NaN out of reach.
        margin: (P, Q) by how much the minimum motor and contact torque could be raised until no torques are feasible,
            seen from the drive [N m]; negative out of reach, zero at the edge.
        copper_loss: (P, Q) sum of the squared drive torques at that preload [N^2 m^2]; NaN out of reach.
    """

    acceleration: Array
    load_torque: Array
    least_preload: Array
    margin: Array
    copper_loss: Array

    def __repr__(self) -> str:
        """Size of the map and share within reach, in one line."""
        shape = f"{self.acceleration.size} accelerations x {self.load_torque.size} load torques"
        return f"CapabilityMap({shape}, {np.mean(self.reachable):.0%} within reach)"

    @property
    def reachable(self) -> NDArray[np.bool_]:
        """(P, Q) whether contact is kept."""
        return np.isfinite(self.copper_loss)

    @property
    def edge(self) -> Array:
        """(Q, 2) least and greatest acceleration [rad/s^2] at each load torque; NaN where there is none.

        The margin is interpolated between the accelerations of the map. An edge outside the map is set to its border.
        """
        found = np.full((self.load_torque.size, 2), np.nan)
        for row, margin in zip(found, self.margin.T, strict=True):
            inside = np.flatnonzero(margin >= 0)
            if inside.size:
                row[:] = self._crossing(margin, inside[0], -1), self._crossing(margin, inside[-1], 1)
        return found

    def _crossing(self, margin: Array, last: int, step: int) -> float:
        """Acceleration [rad/s^2] at which the margin (P,) crosses zero between `last` and `last + step`."""
        beyond = last + step
        if not 0 <= beyond < margin.size:
            return float(self.acceleration[last])
        share = margin[last] / (margin[last] - margin[beyond])
        return float((1 - share) * self.acceleration[last] + share * self.acceleration[beyond])


def capability_map(
    allocator: Allocator, *, inertia: float, acceleration: ArrayLike, load_torque: ArrayLike
) -> CapabilityMap:
    """Accelerations and load torques within reach without loss of contact, their preload and copper-loss index.

    The drives together give J a + tau_L, and each torque stays above its lower bound (motor or contact, see `Limits`).
    The two drives push against each other, so the reachable torque is about half of the sum of both drives.

    With x the torque magnitudes and J a + tau_L = b x, the margin is the greatest t for which a preload c exists with
    lower + t <= x <= upper. In the symbols of `share_between_two`, over all pairs of a lower and an upper bound,

        t = min_ij  u_i (upper_j - e_j tau/|b|)/u_j + e_i tau/|b| - lower_i

    Args:
        allocator: of two drives on one joint.
        inertia: J of the load and both rotors [kg m^2], as in a model fitted to motor torques.
        acceleration: (P,) of the load, rising [rad/s^2].
        load_torque: (Q,) without the inertial torque, rising [N m].

    Raises:
        BadParameter: not two working drives on one joint, or numbers that are not finite, positive, or in order.
    """
    limits, a, load = allocator.bounds, _rising("acceleration", acceleration), _rising("load_torque", load_torque)
    if limits.structure.matrix.shape != (1, 2) or allocator.lost:
        raise BadParameter("A capability map is drawn for two working drives on one joint.")
    if not (np.isfinite(inertia) and inertia > 0):
        raise BadParameter(f"inertia must be finite and above zero, not {inertia!r}.")
    motion, torque = a[:, None], inertia * a[:, None] + load
    pushing = limits.structure.pushing[0]
    size = float(np.linalg.norm(pushing))
    across, along = torque[..., None] * pushing / size**2, np.abs(pushing[::-1]) / size
    from_above = np.min((limits.greatest - across) / along, axis=-1)
    margin = np.min(along * from_above[..., None] + across - limits.lower(motion), axis=-1)
    margin = np.where(np.abs(margin) <= _ROUNDING * np.max(limits.greatest), 0.0, margin)
    torques = least_effort(limits, torque, motion, allocator.weights)
    v = limits.gears.null_vector
    out_of_reach = margin < 0
    return CapabilityMap(
        acceleration=a,
        load_torque=load,
        least_preload=np.where(out_of_reach, np.nan, torques @ v / (v @ v)),
        margin=margin,
        copper_loss=np.where(out_of_reach, np.nan, np.sum(torques**2, axis=-1)),
    )


def _rising(name: str, values: ArrayLike) -> Array:
    numbers = np.asarray(values, dtype=np.float64)
    if numbers.ndim != 1 or not np.all(np.isfinite(numbers)) or np.any(np.diff(numbers) <= 0):
        raise BadParameter(f"{name} must be finite numbers in rising order.")
    return numbers
