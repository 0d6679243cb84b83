"""The quadratic program of the general allocator, and the optimality check of its solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEGLIGIBLE = 1e-11
"""Smaller numbers count as zero; torques are of the order of one."""

_ROUNDING = 1e-14
"""Rounding error of floating point."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Residuals:
    """Optimality residuals of a `QuadraticProgram`; zero at the solution, inf without a certificate."""

    primal: float
    dual: float
    gap: float

    @property
    def largest(self) -> float:
        """The largest of the three."""
        return max(self.primal, self.dual, self.gap)


UNPROVEN = Residuals(primal=np.inf, dual=np.inf, gap=np.inf)


@dataclass(frozen=True, kw_only=True, eq=False)
class QuadraticProgram:
    """Two objectives in lexicographic order under hard constraints (sequential least squares, Harkegard 2002).

        first   minimise |B x - b|          the reachable torque nearest to the demand
        then    minimise sum w_i x_i^2      the least effort that gives it
        rows    C x <= d

    Scaled so that x and B are of the order of one.

    Attributes:
        B, b: (n, m), (n,).
        w: (m,) positive.
        C, d: (r, m), (r,).
    """

    B: Array
    b: Array
    w: Array
    C: Array
    d: Array

    def on(self, rows: NDArray[np.intp]) -> Array:
        """The x (m,) that is optimal for both objectives if exactly the given rows hold with equality."""
        x, free = np.zeros(len(self.w)), np.eye(len(self.w))
        for M, r in ((self.C[rows], self.d[rows]), (self.B, self.b), (np.diag(np.sqrt(self.w)), np.zeros(len(self.w)))):
            if free.shape[1] == 0 or len(M) == 0:
                continue
            U, s, Vt = np.linalg.svd(M @ free)
            rank = int(np.sum(s > NEGLIGIBLE))
            x = x + free @ (Vt[:rank].T @ (U[:, :rank].T @ (r - M @ x) / s[:rank]))
            free = free @ Vt[rank:].T
        return x

    def multipliers(self, x: Array, rows: NDArray[np.intp]) -> Array:
        """(rows, 2) multipliers of both objectives at x, optimal on `rows`; an active row's first nonzero is positive.

        Those of the first objective are scaled to a missing torque of length one, because a demand may be only slightly
        out of reach. Multipliers within rounding error are set to zero.
        """
        E, miss = self.C[rows], self.B @ x - self.b
        size = max(float(np.linalg.norm(miss)), _ROUNDING)
        first = np.linalg.lstsq(E.T, -self.B.T @ miss / size)[0]
        first[np.abs(first) < max(_ROUNDING / size, NEGLIGIBLE)] = 0.0
        then = np.linalg.lstsq(np.vstack((E, self.B)).T, -self.w * x)[0][: len(rows)]
        then[np.abs(then) < NEGLIGIBLE] = 0.0
        return np.stack((first, then), axis=-1)

    def residuals(self, x: Array) -> Residuals:
        """Check x by the Karush-Kuhn-Tucker conditions of both objectives in turn, from x alone.

        First: the negative gradient B'(b - B x) is a sum of active rows with multipliers nu >= 0. Then: the negative
        gradient -W x of the effort, projected on the null space of B (B x is fixed), is such a sum too.
        """
        slack = self.d - self.C @ x
        active = slack <= NEGLIGIBLE
        E = self.C[active]
        nu, first = _nonnegative(E.T, self.B.T @ (self.b - self.B @ x))
        settled = np.linalg.svd(self.B)[2][np.linalg.matrix_rank(self.B, tol=NEGLIGIBLE) :]
        mu, then = _nonnegative(settled @ E.T, -settled @ (self.w * x))
        gap = float(np.max((nu + mu) * np.abs(slack[active]), initial=0.0))
        return Residuals(primal=max(0.0, float(np.max(-slack))), dual=max(first, then), gap=gap)


def _nonnegative(M: Array, r: Array) -> tuple[Array, float]:
    """The y >= 0 that minimises |M y - r|, and that norm; inf if nnls fails."""
    from scipy.optimize import nnls

    if M.shape[1] == 0 or M.shape[0] == 0:
        return np.zeros(M.shape[1]), float(np.linalg.norm(r))
    try:
        y, residual = nnls(M, r)
    except RuntimeError:
        return np.zeros(M.shape[1]), float("inf")
    return np.asarray(y), float(residual)
