"""The quadratic programme of a step, solved and certified."""

from __future__ import annotations

from mpc.interior_point import solve_from_inside
from mpc.riccati import TORQUE_ALONE
from mpc.sweeps import Sweeps

CERTIFIED = 1e-6
"""Largest residual of an accepted solution, in units of the greatest torque."""


class Programme(Sweeps):
    """The programme of `mpc.riccati`, with what solves it."""

    def solve(self) -> float:
        """The minimiser in `e`; the residual, inf if none was certified.

        Newton steps until the active bounds repeat. They end at the minimiser after a few sweeps, but may cycle, and
        know the torques' own bounds alone. Where that is not enough, the interior point method guesses the active
        bounds anew, or, where other intervals are active, is itself the answer. Nothing is believed without `residual`.
        """
        self._active_set()
        if (residual := self.residual()) <= CERTIFIED:
            return residual
        solve_from_inside(self)
        if self.rows == TORQUE_ALONE:
            self._active_set()
        return residual if (residual := self.residual()) <= CERTIFIED else float("inf")

    def _active_set(self) -> None:
        self.forces[:] = 0.0
        for _ in range(self.rounds):
            settled = self.sweep()
            self.bounds[:, 0] = self.held
            if settled:
                break
        self.curvature[:] = self.law[:, -1]
