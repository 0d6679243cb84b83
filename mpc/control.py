"""The result of a controller step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mpc.status import sentence

Array = NDArray[np.float64]

OUTCOME = 3
"""Number of results besides torques and angles: margin, disturbance, residual."""


class Control:
    """The result of the controller at one sample, immutable.

    The numbers of a step stay in one array, and each property reads its part on access. So unused properties cost no
    time in a fast loop.
    """

    __slots__ = ("_drives", "_numbers", "_trouble")

    def __init__(self, numbers: Array, trouble: int = 0, drives: int = 2) -> None:
        """The result of a step.

        Args:
            numbers: margin, disturbance, residual, torques (N, 2) row by row and angles (N + 1,), one after the other.
            trouble: what went wrong, see `Trouble`.
            drives: one or two; a single drive is treated as a pair, one part for each direction.
        """
        self._numbers, self._trouble, self._drives = numbers, trouble, drives

    @property
    def torques(self) -> Array:
        """(m,) pinion torques to apply now [N m]; always inside the bounds."""
        now = self._numbers[OUTCOME : OUTCOME + 2]
        return now if self._drives > 1 else np.asarray(now.sum(keepdims=True))

    @property
    def status(self) -> str:
        """ "optimal", or "degraded: " and the reasons."""
        reasons = sentence(self._trouble)
        return f"degraded: {reasons}" if reasons else "optimal"

    @property
    def margin(self) -> float:
        """Smallest predicted contact torque minus the minimum [N m], of both drives over the horizon, at the pinion.

        It is negative if `max_torque` is too low to keep contact.
        """
        return float(self._numbers[0])

    @property
    def disturbance(self) -> float:
        """Estimated disturbance torque, not part of the model [N m]."""
        return float(self._numbers[1])

    @property
    def residual(self) -> float:
        """Residual of the optimality conditions, see `mpc.quadratic_program.QuadraticProgram.residual`."""
        return float(self._numbers[2])

    @property
    def predicted_torques(self) -> Array:
        """(N, m) pinion torques over the horizon [N m]; the first row is `torques`."""
        pairs = self._numbers[OUTCOME : self._angles].reshape(-1, 2)
        return pairs if self._drives > 1 else np.asarray(pairs.sum(axis=1, keepdims=True))

    @property
    def predicted_angle(self) -> Array:
        """(N + 1,) predicted load angle [rad], the whole samples of dead time left out."""
        return self._numbers[self._angles :]

    @property
    def _angles(self) -> int:
        """Index of the first angle."""
        return OUTCOME + 2 * ((self._numbers.size - OUTCOME - 1) // 3)

    def __repr__(self) -> str:
        """Torques, status and margin, in one line."""
        return f"Control(torques={self.torques.tolist()}, status={self.status!r}, margin={self.margin:.4g})"
