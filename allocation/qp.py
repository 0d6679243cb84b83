"""Quadratic programs solved by qpsolvers with tight tolerances, and the residuals of their solutions."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from plant.errors import BadParameter

if TYPE_CHECKING:
    import qpsolvers

Array = NDArray[np.float64]

_SETTINGS: dict[str, dict[str, Any]] = {
    # The default tolerances of first-order solvers are too loose for a minimum torque. Our programs are scaled and
    # feasible, so OSQP need neither scale them nor detect infeasibility. `raise_error` must be given explicitly.
    "osqp": {
        "eps_abs": 1e-9,
        "eps_rel": 1e-9,
        "eps_prim_inf": 1e-15,
        "eps_dual_inf": 1e-15,
        "max_iter": 20_000,
        "scaling": 0,
        "polishing": True,
        "delta": 1e-9,
        "polish_refine_iter": 10,
        "raise_error": False,
    },
    "proxqp": {"eps_abs": 1e-11},
}


def check_solver(name: str) -> None:
    """Raise `BadParameter` unless the solver is installed."""
    import qpsolvers  # imports every installed solver, so only where it is needed

    if name not in qpsolvers.available_solvers:
        raise BadParameter(
            f"The QP solver {name!r} is not installed; use one of {', '.join(qpsolvers.available_solvers)}."
        )


def solve_qp(
    *,
    P: Array,
    q: Array,
    lb: Array,
    ub: Array,
    A: Array | None = None,
    b: Array | None = None,
    G: Array | None = None,
    h: Array | None = None,
    solver: str = "osqp",
) -> qpsolvers.Solution:
    """Minimise 1/2 x'Px + q'x subject to A x = b, G x <= h and lb <= x <= ub, always from a cold start.

    The problem must be scaled so that x is of the order of one. Check the residuals before use: they are infinite after
    a failed solve. Exceptions and warnings of the solver are suppressed.
    """
    import qpsolvers
    from scipy.sparse import csc_matrix

    sparse = solver in qpsolvers.sparse_solvers
    problem = qpsolvers.Problem(
        P=csc_matrix(P) if sparse else P,
        q=q,
        G=None if G is None else csc_matrix(G) if sparse else G,
        h=h,
        A=None if A is None else csc_matrix(A) if sparse else A,
        b=b,
        lb=lb,
        ub=ub,
    )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return qpsolvers.solve_problem(problem, solver=solver, **_SETTINGS.get(solver, {}))
    except Exception:  # any exception of an external solver counts as a failed solve
        return qpsolvers.Solution(problem)


def largest_residual(solution: qpsolvers.Solution) -> float:
    """The largest of primal residual, dual residual and duality gap; inf if there is no solution."""
    if not solution.found or solution.x is None or not np.all(np.isfinite(solution.x)):
        return float("inf")
    return float(max(solution.primal_residual(), solution.dual_residual(), abs(solution.duality_gap())))
