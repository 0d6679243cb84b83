"""Quadratic programmes with bounds: an active-set Newton method, certified, with a second solver behind it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allocation.qp import largest_residual, solve_qp

Array = NDArray[np.float64]

CERTIFIED = 1e-6
"""Largest residual of an accepted solution, in units of the variable."""

_ITERATIONS = 40


@dataclass(frozen=True, kw_only=True, eq=False)
class BoxSolution:
    """The minimiser of 1/2 x'Hx + g'x within lower <= x <= upper.

    Attributes:
        x: (N,) always inside the bounds, to the last bit; the clipped guess if no solver was certified.
        residual: violation of the optimality conditions, see `optimality_residual`; inf if no solution was found.
        iterations: Newton iterations; those of a second solver are not counted.
    """

    x: Array
    residual: float
    iterations: int

    @property
    def is_optimal(self) -> bool:
        """Whether the solution is certified."""
        return self.residual <= CERTIFIED


def optimality_residual(H: Array, g: Array, lower: Array, upper: Array, x: Array) -> float:
    """max |x - clip(x - (Hx + g)/diag H, lower, upper)|: zero exactly at the minimiser of a convex problem."""
    moved = np.clip(x - (H @ x + g) / np.diag(H), lower, upper)
    residual = float(np.max(np.abs(x - moved)))
    return residual if np.isfinite(residual) else float("inf")


def solve_box_qp(H: Array, g: Array, lower: Array, upper: Array, guess: Array) -> BoxSolution:
    """Minimise 1/2 x'Hx + g'x subject to lower <= x <= upper, H symmetric and positive definite.

    The primal-dual active set method (Hintermueller, Ito, Kunisch 2002): guess which bounds hold with equality, solve
    for the others, correct the guess by the signs of what results. It ends at the minimiser after a few linear solves,
    but may cycle: then OSQP takes over. Nothing is believed without `optimality_residual`.

    Scale the problem so that x is of the order of one.
    """
    start = np.clip(np.nan_to_num(guess), lower, upper)
    if not (np.all(np.isfinite(H)) and np.all(np.isfinite(g)) and np.all(lower <= upper)):
        return BoxSolution(x=start, residual=float("inf"), iterations=0)
    iterations = 0
    try:
        x, iterations = _active_set(H, g, lower, upper, start)
    except np.linalg.LinAlgError:
        x = start
    residual = optimality_residual(H, g, lower, upper, x)
    if residual <= CERTIFIED:
        return BoxSolution(x=x, residual=residual, iterations=iterations)
    size = np.sqrt(np.diag(H))
    answer = solve_qp(P=H / np.outer(size, size), q=g / size, lb=lower * size, ub=upper * size)
    if np.isfinite(largest_residual(answer)) and answer.x is not None:
        x = np.clip(answer.x / size, lower, upper)
        residual = optimality_residual(H, g, lower, upper, x)
        if residual <= CERTIFIED:
            return BoxSolution(x=x, residual=residual, iterations=iterations)
    return BoxSolution(x=start, residual=float("inf"), iterations=iterations)


def _active_set(H: Array, g: Array, lower: Array, upper: Array, start: Array) -> tuple[Array, int]:
    """Newton steps until the active bounds repeat; the last iterate is clipped into the bounds."""
    x, scale = start, np.diag(H)
    pull = -(H @ x + g) / scale
    at_lower, at_upper = x + pull < lower, x + pull > upper
    for iteration in range(1, _ITERATIONS + 1):
        x = np.where(at_lower, lower, np.where(at_upper, upper, 0.0))
        free = ~(at_lower | at_upper)
        if np.any(free):
            x[free] = np.linalg.solve(H[np.ix_(free, free)], -(g[free] + H[np.ix_(free, ~free)] @ x[~free]))
        pull = -(H @ x + g) / scale
        pull[free] = 0.0
        now_lower, now_upper = x + pull < lower, x + pull > upper
        if np.array_equal(now_lower, at_lower) and np.array_equal(now_upper, at_upper):
            return np.clip(x, lower, upper), iteration
        at_lower, at_upper = now_lower, now_upper
    return np.clip(x, lower, upper), _ITERATIONS
