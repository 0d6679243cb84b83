"""The part of the innovations that parameters and initial states can absorb, and the part beyond them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from identification.predictor import Prediction
from plant.effects.effect import Array

_NOTHING = 1e-10  # share of the largest direction; smaller ones are rounding errors
_ROUNDING = 1e-12  # share of a column's sum of squares; a smaller rest is a rounding error


@dataclass(frozen=True, kw_only=True, eq=False)
class Nuisance:
    """Orthonormal directions of the innovations (T,) that a fit can absorb.

    Attributes:
        own: for each run, the directions (T_r, 0 to I) of its initial state.
        shared: (T, 0 to F) directions of the parameters, beyond the initial states.
    """

    own: tuple[Array, ...]
    shared: Array

    @classmethod
    def of(cls, predictions: Sequence[Prediction]) -> Nuisance:
        """From the Jacobians of all runs."""
        free = predictions[0].jacobian.shape[1] - predictions[0].initials
        own = tuple(basis(p.jacobian[:, free:]) for p in predictions)
        shared = np.vstack([p.jacobian[:, :free] for p in predictions])
        return cls(own=own, shared=basis(_beyond(own, shared)))

    def information(self, columns: Array, values: Array) -> tuple[Array, Array]:
        """(M, M) products of columns (T, M) beyond the directions, and (M,) with values (T,) beyond them.

        Zero for a column that is absorbed except for rounding errors, and for one that overflows.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            return self._information(columns, values)

    def _information(self, columns: Array, values: Array) -> tuple[Array, Array]:
        found, first = columns.T @ columns, 0
        whole = np.diag(found).copy()
        for basis in self.own:
            held = basis.T @ columns[first : first + len(basis)]
            found -= held.T @ held
            first += len(basis)
        held = self.shared.T @ columns
        found -= held.T @ held
        left = np.diag(found) > _ROUNDING * whole
        return np.where(np.outer(left, left), found, 0.0), np.where(left, columns.T @ values, 0.0)

    def beyond_initial_states(self, values: Array) -> Array:
        """Part of values (T,) or (T, M) that the initial states cannot absorb."""
        return _beyond(self.own, values)

    def beyond(self, values: Array) -> Array:
        """Part of values (T,) or (T, M) that parameters and initial states cannot absorb."""
        left = self.beyond_initial_states(values)
        left -= self.shared @ (self.shared.T @ left)
        return left


def _beyond(own: Sequence[Array], values: Array) -> Array:
    left, first = values.copy(), 0
    for basis in own:
        rows = slice(first, first + len(basis))
        left[rows] -= basis @ (basis.T @ left[rows])
        first = rows.stop
    return left


def basis(columns: Array) -> Array:
    """Orthonormal basis of the span of columns (T, n).

    The QR factorisation is pivoted. Without pivots a zero column would yield an arbitrary direction, and the columns
    after it would lose their part along it. A column that overflows counts as zero. The columns have different units,
    so they are scaled before.
    """
    if columns.shape[1] == 0:
        return columns
    largest = np.abs(columns).max(axis=0, initial=0.0)
    sound = np.isfinite(largest) & (largest > 0.0)
    scaled = np.divide(columns, largest, out=np.zeros_like(columns), where=sound)
    scaled /= np.maximum(np.linalg.norm(scaled, axis=0), 1.0)
    basis, triangle, _ = qr(scaled, mode="economic", pivoting=True)
    size = np.abs(np.diag(triangle))
    return np.ascontiguousarray(basis[:, size > _NOTHING * size.max()])
