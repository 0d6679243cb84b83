"""The quadratic program of a step, solved and certified."""

from __future__ import annotations

from mpc.active_set import find_active_set
from mpc.interior_point import solve_from_inside
from mpc.riccati import ALL_ROWS, TORQUE_ALONE
from mpc.sweeps import CERTIFIED, Sweeps

ROUNDS = {TORQUE_ALONE: 25, ALL_ROWS: 50}
"""Bound on the sweeps of each method; two are usual, 20 where other intervals than those of the torque are active."""


class QuadraticProgram(Sweeps):
    """The program of `mpc.riccati`, with what solves it."""

    def solve(self) -> float:
        """The minimiser in `e`; the residual, inf if none was certified.

        The active set ends at the minimiser after a few sweeps, but may cycle. Then the interior point method guesses
        it anew, or, where other intervals than those of the torque are active, is itself the answer. Nothing is
        believed without `residual`; where leaving an interval has a price, that little would be dear, and the active
        set must have come to its end too.
        """
        settled = find_active_set(self)
        if (residual := self.residual()) <= CERTIFIED and (settled or self.rows == TORQUE_ALONE):
            return residual
        solve_from_inside(self)
        if self.rows == TORQUE_ALONE:
            find_active_set(self)
        return residual if (residual := self.residual()) <= CERTIFIED else float("inf")
