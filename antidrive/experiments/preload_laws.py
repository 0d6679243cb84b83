"""Laws of torque allocation between drive and anti-drive, each sized for the motions of the machine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from allocation import Bounds, least_effort
from antidrive.experiments.outcome import Array
from plant.rig import Rig

ONE, SIZED, WARM, SHAPED, PLANNED = LAWS = (
    "one drive",
    "constant preload",
    "constant preload of equal copper loss",
    "load-dependent preload of equal copper loss",
    "least effort by contact torque",
)


@dataclass(frozen=True, kw_only=True)
class PreloadLaws:
    """Laws of the preload p, the torque of each pinion without load, over the output torque tau.

        constant         p is enough for the peak: n p >= |J_L a + tau_L|/2 + n (T_min + f)   (equal split)
        of equal loss    p such that the copper loss equals that of least effort
        load-dependent   p = max(p0 - |tau|/(2 n), 0): high without load; it decreases as the load itself keeps one
                         mesh in contact, until both drives share (inverse law of the Deep Space Network's antennas;
                         Gawronski et al., IEEE Antennas and Propagation Magazine 42(6), 2000); p0 by its loss
        least effort     `allocation.least_effort` with every flank kept above T_min

    Attributes:
        bounds: of the two pinions; n, T_min, the motors' friction f and greatest torque.
        sized: p of the first law [N m].
        warm: p of the second [N m].
        full: p0 of the third [N m].
    """

    bounds: Bounds
    sized: float
    warm: float
    full: float

    @classmethod
    def for_demand(cls, bounds: Bounds, torque: Array, acceleration: Array) -> PreloadLaws:
        """Laws sized for output torques (T,) [N m], rotors included, at accelerations (T,) [rad/s^2]."""
        ratio = float(bounds.gears.mesh_ratios[0])
        rotors = float(np.sum(bounds.rotor_inertias * bounds.gears.motor_ratios**2))
        load = np.max(np.abs(torque - rotors * acceleration))
        loss = float(np.mean(np.sum(least_effort(bounds, torque, acceleration) ** 2, axis=1)))

        def same_heat(law: Callable[[Array, float], Array]) -> float:
            def surplus(preload: float) -> float:
                torques = _allocated(bounds, torque, law(torque, preload))
                return float(np.mean(np.sum(torques**2, axis=1))) - loss

            return float(brentq(surplus, 0.0, 2.0 * float(np.max(bounds.greatest))))

        return cls(
            bounds=bounds,
            sized=float(0.5 * load / ratio + np.max(bounds.floor)),
            warm=same_heat(lambda torque, preload: np.full(torque.shape, preload)),
            full=same_heat(lambda torque, preload: _faded(bounds, torque, preload)),
        )

    def pinion_torques(self, law: str, torque: Array, planned: Array) -> Array:
        """Pinion torques (B, m) [N m] for output torques (B,) [N m], m = 1 for `ONE`; clipped to the greatest torque.

        Args:
            law: one of `LAWS`.
            torque: (B,) [N m].
            planned: (B, 2) pinion torques of least effort [N m].
        """
        if law == PLANNED:
            return planned
        if law == ONE:
            torques = torque[:, None] / self.bounds.gears.torque_map[1]
        elif law == SHAPED:
            torques = _allocated(self.bounds, torque, _faded(self.bounds, torque, self.full))
        else:
            torques = _allocated(self.bounds, torque, np.full(torque.shape, self.sized if law == SIZED else self.warm))
        return np.asarray(np.clip(torques, -self.bounds.greatest[0], self.bounds.greatest[0]))


def _allocated(bounds: Bounds, torque: Array, preload: Array) -> Array:
    """Equation (3), with the preload as torque of the first pinion."""
    return bounds.gears.pinion_torques(torque, preload / bounds.gears.null_vector[0])


def _faded(bounds: Bounds, torque: Array, full: float) -> Array:
    return np.asarray(np.maximum(full - 0.5 * np.abs(torque) / bounds.gears.mesh_ratios[0], 0.0))


def joule(rig: Rig, torques: Array) -> Array:
    """(...,) copper loss [W] of pinion torques (..., m) [N m]: R i^2, i = xi/(r k) with a reduction r."""
    current = torques / (rig.gears.pre_reductions[0] * rig.torque_constant)
    return np.asarray(rig.winding_resistance * np.sum(current**2, axis=-1))
