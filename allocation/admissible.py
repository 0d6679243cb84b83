"""Which redundant unidirectional drives can hold every joint free of backlash."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plant.errors import BadParameter

Array = NDArray[np.float64]

_MOST_DRIVES = 12
"""The directions are tried one by one: 2^11 linear programs take a few seconds."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Admissibility:
    """Whether a drive structure is admissible, and how evenly it shares the preload.

    Attributes:
        admissible: whether drives that only push can produce every joint torque and a preload of any size.
        score: smallest entry of the null vector below, from 0 (not admissible) to 1/m (balanced).
        null_vector: (m,) the null vector with entries that sum to one and the largest smallest entry: the direction of
            preload; zeros if there is none.
        rank: rank of A.
    """

    admissible: bool
    score: float
    null_vector: Array
    rank: int


def structure_matrix(A: ArrayLike) -> Array:
    """A as a matrix (n, m) of finite numbers.

    Raises:
        BadParameter: A is not a finite matrix.
    """
    try:
        matrix = np.array(A, dtype=np.float64)
    except (TypeError, ValueError):
        raise BadParameter("A must be a matrix of numbers with rows of one length.") from None
    if matrix.ndim != 2 or matrix.size == 0 or not np.all(np.isfinite(matrix)):
        raise BadParameter(f"A must be a matrix of finite numbers, not an array of shape {matrix.shape}.")
    return matrix


def null_space(A: ArrayLike) -> Array:
    """Orthonormal basis (m, m - rank A) of the drive torques xi without joint torque, A xi = 0.

    For the paper's two pinions it is the single direction [N1, -N2] of equation (3), as a unit vector.

    Raises:
        BadParameter: A is not a finite matrix.
    """
    matrix = _unit_rows(structure_matrix(A))
    return np.asarray(np.linalg.svd(matrix)[2][_rank(matrix) :].T)


def admissible(A: ArrayLike) -> Admissibility:
    """Decide whether u = A xi with xi >= 0 is an admissible redundant-drive structure (Chang and Tsai 1993).

    A (n x m) maps the torques of m unidirectional drives to n joints; the sign of a column is the drive's direction.
    The structure is admissible if and only if rank A = n, A v = 0 has a strictly positive solution, and no column is
    zero. The linear program

        maximise t   subject to   A v = 0,  v >= t,  sum v = 1

    finds v; its maximum t scores how evenly the drives can share the preload.

    Raises:
        BadParameter: A is not a finite matrix.
    """
    from scipy.optimize import linprog

    matrix = structure_matrix(A)
    n, m = matrix.shape
    scaled = _unit_rows(matrix)
    rank = _rank(scaled)
    answer = linprog(
        np.append(np.zeros(m), -1.0),
        A_ub=np.hstack((-np.eye(m), np.ones((m, 1)))),
        b_ub=np.zeros(m),
        A_eq=np.vstack((np.hstack((scaled, np.zeros((n, 1)))), np.append(np.ones(m), 0.0))),
        b_eq=np.append(np.zeros(n), 1.0),
        bounds=[(0.0, None)] * (m + 1),
        method="highs",
    )
    vector = np.asarray(answer.x[:m], dtype=np.float64) if answer.x is not None else np.zeros(m)
    score = float(np.min(vector))
    ok = rank == n and score > 1e-9 and bool(np.all(np.any(matrix != 0, axis=0)))
    return Admissibility(admissible=ok, score=score if ok else 0.0, null_vector=vector, rank=rank)


def admissible_directions(A: ArrayLike) -> list[NDArray[np.int64]]:
    """Torque directions (m,), each +1 or -1, with which drives of torque map A (n x m) keep all joints backlash-free.

    They are the sign patterns of the null vectors of A without zero entries; the reverse of each is listed too. For
    the paper's two pinions they are [+ -] (lambda > 0 in equation 3) and [- +] (lambda < 0).

    Raises:
        BadParameter: A is not a finite matrix, or has more than 12 columns.
    """
    matrix = structure_matrix(A)
    m = matrix.shape[1]
    if m > _MOST_DRIVES:
        raise BadParameter(f"Directions are listed for up to {_MOST_DRIVES} drives, not {m}.")
    halves = (np.array((1, *rest), dtype=np.int64) for rest in product((1, -1), repeat=m - 1))
    found = [direction for direction in halves if admissible(matrix * direction).admissible]
    return [*found, *(-direction for direction in reversed(found))]


def _unit_rows(matrix: Array) -> Array:
    """Rows scaled to unit length, so that all joints have the same weight."""
    size = np.linalg.norm(matrix, axis=1, keepdims=True)
    return np.asarray(matrix / np.where(size > 0, size, 1.0))


def _rank(matrix: Array) -> int:
    return int(np.linalg.matrix_rank(matrix))
