"""Make a solution exact: from the rows that a solver reports as active to the solution on the right ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allocation.quadratic_program import NEGLIGIBLE, QuadraticProgram

Array = NDArray[np.float64]
Rows = NDArray[np.intp]


def solve_exactly(program: QuadraticProgram, guess: Rows, pinned: Rows, inside: Array) -> Array:
    """The solution of a program by a primal active-set method (Harkegard 2002) that starts from a guess.

    A good guess is confirmed by one linear solve. A bad one is abandoned for a point that keeps to all rows; from there
    each iteration goes to the best point on the working rows, stops at the first other row in its way and adds it, or
    drops a row whose multiplier has the wrong sign. The rows are never broken on the way.

    Args:
        program: what to solve.
        guess: indices of the rows that are probably active.
        pinned: indices of rows that hold with equality everywhere, which are never dropped.
        inside: (m,) a point that keeps to all rows.

    Returns:
        (m,) x. It is not certified: see `QuadraticProgram.residuals`.
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
    """x after as much of the step as the other rows allow, and the row that stopped it."""
    towards = program.C @ step
    towards[working] = 0.0
    slack = np.maximum(program.d - program.C @ x, 0.0)
    share = np.full(len(slack), np.inf)
    ahead = towards > NEGLIGIBLE
    share[ahead] = slack[ahead] / towards[ahead]
    first = int(np.argmin(share))
    return (x + step, None) if share[first] >= 1.0 else (x + share[first] * step, first)


def _wrong_row(multipliers: Array, kept: NDArray[np.bool_]) -> int | None:
    """The row whose multipliers say most clearly that it should go, in the order of the aims."""
    for aim in multipliers.T:
        judged = np.where(kept, 0.0, aim)
        if np.min(judged, initial=0.0) < 0.0:
            return int(np.argmin(judged))
        kept = kept | (aim > 0.0)
    return None
