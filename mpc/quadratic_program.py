"""The quadratic program of a step, solved and certified."""

from __future__ import annotations

from mpc.active_set import find_active_set
from mpc.interior_point import solve_from_inside
from mpc.riccati import ALL_ROWS, TORQUE_ALONE
from mpc.riccati_sweeps import CERTIFIED, Sweeps

ROUNDS = {TORQUE_ALONE: 25, ALL_ROWS: 50}
"""Greatest number of sweeps of each method; two are usual, 20 if intervals other than the torque's are active."""


class QuadraticProgram(Sweeps):
    """The program of `mpc.riccati` with its solvers."""

    def solve(self) -> float:
        """Write the minimiser to `e`; returns the residual, inf if it is not certified.

        The active set method reaches the minimiser after a few sweeps, but may cycle. Then the interior point method
        gives a new initial active set, or, if the program has intervals other than the torque's, the solution itself.
        `residual` certifies the result. With such intervals the active set must also have converged, because a small
        residual times a high price may change the cost noticeably.
        """
        settled = find_active_set(self)
        if (residual := self.residual()) <= CERTIFIED and (settled or self.rows == TORQUE_ALONE):
            return residual
        solve_from_inside(self)
        if self.rows == TORQUE_ALONE:
            find_active_set(self)
        return residual if (residual := self.residual()) <= CERTIFIED else float("inf")
