"""Which redundant unidirectional drives can hold every joint free of backlash."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations_with_replacement, permutations, product

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog

from plant.errors import BadParameter

Array = NDArray[np.float64]


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


def admissible(A: ArrayLike) -> Admissibility:
    """Decide whether u = A xi with xi >= 0 is an admissible redundant-drive structure (Chang and Tsai 1993).

    A (n x m) maps the torques of m unidirectional drives to n joints; a drive's sense is the sign of its column. The
    structure is admissible if and only if rank A = n, A v = 0 has a strictly positive solution, and every drive takes
    part (no column is zero). The linear programme

        maximise t   subject to   A v = 0,  v >= t,  sum v = 1

    decides it and scores how evenly the preload can be shared.

    Raises:
        BadParameter: A is not a finite matrix.
    """
    matrix = np.asarray(A, dtype=np.float64)
    if matrix.ndim != 2 or matrix.size == 0 or not np.all(np.isfinite(matrix)):
        raise BadParameter(f"A must be a matrix of finite numbers, not an array of shape {matrix.shape}.")
    n, m = matrix.shape
    size = np.linalg.norm(matrix, axis=1, keepdims=True)
    scaled = matrix / np.where(size > 0, size, 1.0)
    rank = int(np.linalg.matrix_rank(scaled))
    cost = np.append(np.zeros(m), -1.0)
    answer = linprog(
        cost,
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


def enumerate_admissible(n: int, m: int) -> list[NDArray[np.int64]]:
    """All sign patterns (n x m) that belong to admissible structures, one for each class of equal ones.

    Patterns that differ by the order of joints (rows) or drives (columns) are equal. A pattern is listed if some sizes
    of its entries make it admissible: each row then holds entries of both signs and no column is empty, and random
    sizes balanced to a common positive null vector leave rank n.

    Args:
        n: joints, 1 to 3.
        m: drives, n + 1 to 2 n.

    Raises:
        BadParameter: n or m out of that range.
    """
    if not 1 <= n <= 3:
        raise BadParameter(f"Structures are enumerated for 1 to 3 joints, not {n}.")
    if not n + 1 <= m <= 2 * n:
        raise BadParameter(f"{n} joints need {n + 1} to {2 * n} drives, not {m}.")
    found: dict[tuple[tuple[int, ...], ...], None] = {}
    for pattern in _patterns(n, m):
        key = _canonical(pattern)
        if key not in found and _can_be_admissible(np.array(pattern).T):
            found[key] = None
    return [np.array(columns, dtype=np.int64).T for columns in sorted(found, reverse=True)]


def _patterns(n: int, m: int) -> Iterator[tuple[tuple[int, ...], ...]]:
    """Multisets of m columns of signs, none empty, each row with both signs."""
    columns = [c for c in product((1, 0, -1), repeat=n) if any(c)]
    for chosen in combinations_with_replacement(columns, m):
        if all(1 in row and -1 in row for row in zip(*chosen, strict=True)):
            yield chosen


def _canonical(pattern: tuple[tuple[int, ...], ...]) -> tuple[tuple[int, ...], ...]:
    """The greatest of all patterns that differ only by the order of rows and columns, as columns."""
    n = len(pattern[0])
    return max(tuple(sorted((tuple(c[i] for i in p) for c in pattern), reverse=True)) for p in permutations(range(n)))


def _can_be_admissible(pattern: NDArray[np.int64]) -> bool:
    """Whether sizes exist that give rank n; balanced rows, A 1 = 0, lose nothing: columns scale freely."""
    sizes = np.random.default_rng(0).uniform(0.5, 2.0, pattern.shape)
    positive, negative = sizes * (pattern > 0), sizes * (pattern < 0)
    balanced = positive / positive.sum(axis=1, keepdims=True) - negative / negative.sum(axis=1, keepdims=True)
    return bool(np.linalg.matrix_rank(balanced) == pattern.shape[0])
