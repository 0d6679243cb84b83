"""What the parameters at hand and the initial states can absorb of innovations, and what is beyond them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from identification.predictor import Prediction
from plant.effects.effect import Array

_NOTHING = 1e-10  # of the largest direction, below which a direction is rounding
_ROUNDING = 1e-12  # of the squares of a column, below which what is left of them is rounding


@dataclass(frozen=True, kw_only=True, eq=False)
class Nuisance:
    """Orthonormal directions of the innovations (T,) that a fit can follow.

    Attributes:
        own: for each run the directions (T_r, 0 to 2) of its initial state.
        shared: (T, 0 to F) those of the parameters, beyond the initial states.
    """

    own: tuple[Array, ...]
    shared: Array

    @classmethod
    def of(cls, predictions: Sequence[Prediction]) -> Nuisance:
        """From the Jacobians of all runs."""
        free = predictions[0].jacobian.shape[1] - 2
        own = tuple(basis(p.jacobian[:, free:]) for p in predictions)
        shared = np.vstack([p.jacobian[:, :free] for p in predictions])
        return cls(own=own, shared=basis(_beyond(own, shared)))

    def information(self, columns: Array, values: Array) -> tuple[Array, Array]:
        """(M, M) and (M,) products of what is beyond of columns (T, M) with itself and with values (T,) beyond.

        Zero for a column of which nothing is beyond but rounding, and for one that overflows.
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
        """What no initial state can follow of values (T,) or (T, M)."""
        return _beyond(self.own, values)

    def beyond(self, values: Array) -> Array:
        """What no parameter and no initial state can follow of values (T,) or (T, M)."""
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
    """Orthonormal basis of what columns (T, n) span.

    With pivots: where a column is nothing, as that of an instant at which the load rests, those behind it would lose
    what they share with the arbitrary direction in its place. A column that overflows is no direction either. Each has
    a unit of its own, so it is their directions that are compared.
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
