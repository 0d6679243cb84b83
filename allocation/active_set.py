"""Active-set method: refines an approximate solution of a solver to the exact solution on the active rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allocation.quadratic_program import NEGLIGIBLE, QuadraticProgram

Array = NDArray[np.float64]
Rows = NDArray[np.intp]


def solve_exactly(program: QuadraticProgram, guess: Rows, pinned: Rows, inside: Array) -> Array:
    """Solve a program by a primal active-set method (Harkegard 2002) that starts from a guess of the active rows.

    One linear solve confirms a correct guess. If its solution violates a row, the method restarts from the feasible
    point `inside`. Each iteration moves towards the best point on the working rows; it stops at the first other row
    that it reaches and adds that row, or it drops a row whose multiplier has the wrong sign. Every iterate is feasible.

    Args:
        program: the program to solve.
        guess: indices of the rows that are probably active.
        pinned: indices of rows that hold with equality everywhere; they are never dropped.
        inside: (m,) a feasible point.

    Returns:
        (m,) x, not certified: see `QuadraticProgram.residuals`.
    """
    working = np.union1d(guess, pinned).astype(np.intp)
    x = program.on(working)
    if np.max(program.C @ x - program.d) > NEGLIGIBLE:
        x = inside
        working = np.flatnonzero(program.d - program.C @ x <= NEGLIGIBLE)
    for _ in range(4 * len(program.d)):
        x, blocking = _until_blocked(program, x, program.on(working) - x, working)
        if blocking is not None:
            working = np.append(working, blocking)
            continue
        wrong = _wrong_row(program.multipliers(x, working), np.isin(working, pinned))
        if wrong is None:
            break
        working = np.delete(working, wrong)
    return x


def _until_blocked(program: QuadraticProgram, x: Array, step: Array, working: Rows) -> tuple[Array, int | None]:
    """x after the largest part of the step that the other rows allow, and the row that limits it (None: full step)."""
    towards = program.C @ step
    towards[working] = 0.0
    slack = np.maximum(program.d - program.C @ x, 0.0)
    share = np.full(len(slack), np.inf)
    ahead = towards > NEGLIGIBLE
    share[ahead] = slack[ahead] / towards[ahead]
    first = int(np.argmin(share))
    return (x + step, None) if share[first] >= 1.0 else (x + share[first] * step, first)


def _wrong_row(multipliers: Array, kept: NDArray[np.bool_]) -> int | None:
    """The row with the most negative multiplier, for the first objective before the second; None: x is optimal."""
    for aim in multipliers.T:
        judged = np.where(kept, 0.0, aim)
        if np.min(judged, initial=0.0) < 0.0:
            return int(np.argmin(judged))
        kept = kept | (aim > 0.0)
    return None
