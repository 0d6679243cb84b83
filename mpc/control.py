"""What a controller hands out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mpc.trouble import sentence

Array = NDArray[np.float64]

OUTCOME = 3
"""Numbers of a step besides torques and angles: margin, disturbance, residual."""


class Control:
    """What the controller hands out at one sample, fixed.

    A step leaves its numbers as they are, and an attribute reads its own among them when it is asked for: what nobody
    looks at in a fast loop costs nothing.
    """

    __slots__ = ("_drives", "_numbers", "_trouble")

    def __init__(self, numbers: Array, trouble: int = 0, drives: int = 2) -> None:
        """Of a step.

        Args:
            numbers: margin, disturbance, residual, torques (N, 2) row by row and angles (N + 1,), one after the other.
            trouble: what went wrong, see `Trouble`.
            drives: one or two; a single one is the pair of its own senses.
        """
        self._numbers, self._trouble, self._drives = numbers, trouble, drives

    @property
    def torques(self) -> Array:
        """(2,) pinion torques to apply now [N m]; always inside the bounds."""
        now = self._numbers[OUTCOME : OUTCOME + 2]
        return now if self._drives > 1 else np.asarray(now.sum(keepdims=True))

    @property
    def status(self) -> str:
        """ "optimal", or "degraded: " and why."""
        reasons = sentence(self._trouble)
        return f"degraded: {reasons}" if reasons else "optimal"

    @property
    def margin(self) -> float:
        """Least predicted flank torque above the minimum [N m], over both drives and the horizon, seen from the pinion.

        It is negative where `max_torque` cannot hold the teeth together.
        """
        return float(self._numbers[0])

    @property
    def disturbance(self) -> float:
        """Estimated torque that the model does not know [N m]."""
        return float(self._numbers[1])

    @property
    def residual(self) -> float:
        """How far from optimal, see `mpc.quadratic_program.QuadraticProgram.residual`."""
        return float(self._numbers[2])

    @property
    def predicted_torques(self) -> Array:
        """(N, 2) pinion torques over the horizon [N m], the first row being `torques`."""
        pairs = self._numbers[OUTCOME : self._angles].reshape(-1, 2)
        return pairs if self._drives > 1 else np.asarray(pairs.sum(axis=1, keepdims=True))

    @property
    def predicted_angle(self) -> Array:
        """(N + 1,) load angle from now on [rad], a delay of whole samples being left out."""
        return self._numbers[self._angles :]

    @property
    def _angles(self) -> int:
        """Where the angles begin."""
        return OUTCOME + 2 * ((self._numbers.size - OUTCOME - 1) // 3)

    def __repr__(self) -> str:
        """Torques and status, as they are looked at in a loop."""
        return f"Control(torques={self.torques.tolist()}, status={self.status!r}, margin={self.margin:.4g})"
