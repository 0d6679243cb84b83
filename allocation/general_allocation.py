"""Allocation of joint torques to any number of drives, by a quadratic program that is always feasible."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from allocation.active_set import solve_exactly
from allocation.least_effort import settled, share_between_two
from allocation.qp import largest_residual, solve_qp
from allocation.quadratic_program import UNPROVEN, QuadraticProgram, Residuals
from allocation.rows import Rows

if TYPE_CHECKING:
    import qpsolvers

Array = NDArray[np.float64]

CERTIFIED = 1e-9
"""Largest residual of an accepted solution, with torques in units of the greatest torque."""

_SOLVED = 1e-6
"""Largest residual at which the solver's result counts as solved, in the same units."""

_TORQUE_FIRST = 1e2
"""Weight of missing torque relative to effort. Only the solver uses it: the exact solution is the limit of infinity."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sharing:
    """How a torque is shared.

    Attributes:
        x: (m,) magnitudes of the drive torques [N m], inside their bounds to the last bit.
        residuals: of the optimality conditions, with torques in units of the greatest torque.
        instead: method used where the solver's result was not certified; otherwise empty.
    """

    x: Array
    residuals: Residuals
    instead: str = ""


def share_in_closed_form(pushing: Array, torque: Array, rows: Rows, weights: Array) -> Sharing:
    """The same as `share` for two drives on one joint, without a solver: see `share_between_two`."""
    preload = None
    if rows.preload is not None:  # P x = u u'x limits c = u'x once for each drive
        limits = rows.preload / np.sqrt(np.diag(rows.projection))[:, None]
        preload = np.array([np.max(limits[:, 0]), np.min(limits[:, 1])])
    x = share_between_two(pushing[0], torque[0], rows.lower, rows.upper, weights, preload)
    unit = _unit(rows)
    return Sharing(x=x, residuals=_quadratic_program(pushing, torque, rows, weights, unit).residuals(x / unit))


def share(pushing: Array, torque: Array, rows: Rows, weights: Array, solver: str) -> Sharing:
    """Reach the joint torque nearest to the demand that the rows allow, with the least effort sum w_i x_i^2.

    The solver gets one program, feasible for every demand,

        minimise    1/2 x' W x + 1/2 gamma |s|^2    subject to    B x + s = tau  and the rows,

    and its multipliers show the active rows. `solve_exactly` then gives the exact solution, and
    `QuadraticProgram.residuals` certifies it. If the solver fails, the exact method starts without a guess.

    Args:
        pushing: (n, m) B, torque on each joint for one newton metre of each drive in its direction.
        torque: (n,) tau [N m].
        rows: the constraints.
        weights: (m,) w, positive.
        solver: name of the solver in qpsolvers.
    """
    unit, m = _unit(rows), pushing.shape[1]
    program = _quadratic_program(pushing, torque, rows, weights, unit)
    solution = _solve(program, m, solver)
    solved = largest_residual(solution) <= _SOLVED
    guess = _active(program, solution, m) if solved else np.zeros(0, dtype=np.intp)
    pinned = np.flatnonzero(rows.lower == rows.upper)
    x = solve_exactly(program, guess, pinned, rows.inside / unit)
    residuals = program.residuals(x)
    instead = "" if solved else "the exact method"
    if residuals.largest > CERTIFIED:  # keep the preload and give up the torque
        x, residuals, instead = rows.inside / unit, UNPROVEN, "the preload alone"
    return Sharing(x=settled(x * unit, rows.lower, rows.upper), residuals=residuals, instead=instead)


def _unit(rows: Rows) -> float:
    """Torque unit by which the program is scaled [N m]: the greatest bound of any row."""
    return max(float(np.max(np.abs(rows.upper))), float(np.max(np.abs(rows.lower))), np.finfo(float).tiny)


def _quadratic_program(pushing: Array, torque: Array, rows: Rows, weights: Array, unit: float) -> QuadraticProgram:
    """The program with its rows in this order: x <= upper, x >= lower, upper and lower limits of the preload."""
    size, eye = float(np.linalg.norm(pushing)), np.eye(pushing.shape[1])
    C, d = [eye, -eye], [rows.upper, -rows.lower]
    if rows.preload is not None:
        C += [rows.projection, -rows.projection]
        d += [rows.preload[:, 1], -rows.preload[:, 0]]
    return QuadraticProgram(
        B=pushing / size,
        b=torque / (size * unit),
        w=weights / np.max(weights),
        C=np.vstack(C),
        d=np.concatenate(d) / unit,
    )


def _solve(program: QuadraticProgram, m: int, solver: str) -> qpsolvers.Solution:
    """Solve the program in x and s with the given solver."""
    n = len(program.b)
    no_limit = np.full(n, np.inf)
    G, h = (np.hstack((program.C[2 * m :], np.zeros((len(program.d) - 2 * m, n)))), program.d[2 * m :])
    return solve_qp(
        P=np.diag(np.concatenate((program.w, np.full(n, _TORQUE_FIRST)))),
        q=np.zeros(m + n),
        lb=np.concatenate((-program.d[m : 2 * m], -no_limit)),
        ub=np.concatenate((program.d[:m], no_limit)),
        A=np.hstack((program.B, np.eye(n))),
        b=program.b,
        G=G if len(h) else None,
        h=h if len(h) else None,
        solver=solver,
    )


def _active(program: QuadraticProgram, solution: qpsolvers.Solution, m: int) -> NDArray[np.intp]:
    """The active rows of a solution: their multiplier is larger than their slack."""
    x, z, box = solution.x, solution.z, solution.z_box
    if x is None or box is None:
        return np.zeros(0, dtype=np.intp)
    multipliers = np.concatenate((box[:m], -box[:m], z if z is not None else np.zeros(0)))
    slack = program.d - program.C @ x[:m]
    return np.flatnonzero(multipliers > slack)
