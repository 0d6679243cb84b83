"""Which redundant unidirectional drives can hold every joint free of backlash."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plant.errors import BadParameter

Array = NDArray[np.float64]

_MOST_DRIVES = 12
"""Senses are tried one by one: 2^11 linear programs take a few seconds."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Admissibility:
    """The verdict on one drive structure.

    Attributes:
        admissible: whether drives that only push can produce every joint torque and a preload of any size.
        score: least entry of the best null vector whose entries sum to one, in 0 (not admissible) .. 1/m (balanced).
        null_vector: (m,) that null vector, the direction of preload; zeros if there is none.
        rank: rank of A.
    """

    admissible: bool
    score: float
    null_vector: Array
    rank: int


def structure_matrix(A: ArrayLike) -> Array:
    """A as a matrix (n, m) of finite numbers.

    Raises:
        BadParameter: it is none.
    """
    try:
        matrix = np.array(A, dtype=np.float64)
    except (TypeError, ValueError):
        raise BadParameter("A must be a matrix of numbers with rows of one length.") from None
    if matrix.ndim != 2 or matrix.size == 0 or not np.all(np.isfinite(matrix)):
        raise BadParameter(f"A must be a matrix of finite numbers, not an array of shape {matrix.shape}.")
    return matrix


def null_space(A: ArrayLike) -> Array:
    """Orthonormal basis (m, m - rank A) of the drive torques xi that move nothing, A xi = 0.

    For the paper's two pinions it is the one direction [N1, -N2] of equation (3), as a unit vector.

    Raises:
        BadParameter: A is not a finite matrix.
    """
    matrix = _unit_rows(structure_matrix(A))
    return np.asarray(np.linalg.svd(matrix)[2][_rank(matrix) :].T)


def admissible(A: ArrayLike) -> Admissibility:
    """Decide whether u = A xi with xi >= 0 is an admissible redundant-drive structure (Chang and Tsai 1993).

    A (n x m) maps the torques of m unidirectional drives to n joints; a drive's sense is the sign of its column. The
    structure is admissible if and only if rank A = n, A v = 0 has a strictly positive solution, and every drive takes
    part (no column is zero). The linear program

        maximise t   subject to   A v = 0,  v >= t,  sum v = 1

    decides it and scores how evenly the preload can be shared.

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


def admissible_senses(A: ArrayLike) -> list[NDArray[np.int64]]:
    """The senses (m,), each +1 or -1, in which drives with the torque map A (n x m) hold every joint free of backlash.

    They are the sign patterns of the null vectors of A without a zero; with every sense its reverse is one too. For the
    paper's two pinions: [+ -], which is lambda > 0 in equation (3), and [- +], which is lambda < 0.

    Raises:
        BadParameter: A is not a finite matrix, or has more than 12 columns.
    """
    matrix = structure_matrix(A)
    m = matrix.shape[1]
    if m > _MOST_DRIVES:
        raise BadParameter(f"Senses are listed for up to {_MOST_DRIVES} drives, not {m}.")
    halves = (np.array((1, *rest), dtype=np.int64) for rest in product((1, -1), repeat=m - 1))
    found = [sense for sense in halves if admissible(matrix * sense).admissible]
    return [*found, *(-sense for sense in reversed(found))]


def _unit_rows(matrix: Array) -> Array:
    """Rows of length one, so that joints of any size count alike."""
    size = np.linalg.norm(matrix, axis=1, keepdims=True)
    return np.asarray(matrix / np.where(size > 0, size, 1.0))


def _rank(matrix: Array) -> int:
    return int(np.linalg.matrix_rank(matrix))
