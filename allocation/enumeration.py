"""All admissible sign patterns of the drives, one of each equivalence class."""

from __future__ import annotations

from itertools import chain, combinations_with_replacement, permutations, product

import numpy as np
from numpy.typing import NDArray

from plant.errors import BadParameter

Signs = NDArray[np.int64]


def enumerate_admissible(n: int, m: int) -> list[Signs]:
    """All sign patterns (n x m) of admissible structures, one for each equivalence class.

    Patterns that differ only in the order of joints (rows) or drives (columns) are equivalent. A pattern is listed if
    some magnitudes of its entries make it admissible (see `admissible`): each row has entries of both signs, no column
    is zero, and the matrix has rank n when its rows are scaled to a positive null vector. m covers all numbers of
    drives that Chang and Tsai (1993) allow.

    For n = 1 the two patterns of the paper, [+ -] and [- +], are equivalent (drives exchanged), but both are listed.
    `admissible_directions` lists the directions for a given machine.

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
    columns = np.array([signs for signs in product((1, 0, -1), repeat=n) if any(signs)], dtype=np.int64)
    chosen = _multisets(len(columns), m)
    chosen = chosen[_both_signs(columns[chosen])]
    chosen = chosen[_first_of_its_class(chosen, columns)]
    patterns = columns[chosen].transpose(0, 2, 1)
    found = list(patterns[_full_rank(patterns)])
    return [found[0], -found[0]] if n == 1 else found


def _multisets(kinds: int, size: int) -> Signs:
    """(K, size) all combinations of `size` out of `kinds` with repetition, each in rising order."""
    flat = chain.from_iterable(combinations_with_replacement(range(kinds), size))
    return np.fromiter(flat, dtype=np.int64).reshape(-1, size)


def _both_signs(patterns: Signs) -> NDArray[np.bool_]:
    """(K,) whether in patterns (K, m, n) each joint is driven in both directions."""
    return np.asarray(np.all(np.any(patterns == 1, axis=1) & np.any(patterns == -1, axis=1), axis=1))


def _first_of_its_class(chosen: Signs, columns: Signs) -> NDArray[np.bool_]:
    """(K,) whether no permutation of the rows gives a multiset of columns that sorts before this one."""
    n, m = columns.shape[1], chosen.shape[1]
    place = {tuple(column): index for index, column in enumerate(columns.tolist())}
    digits = len(columns) ** np.arange(m)[::-1]
    images = []
    for order in permutations(range(n)):
        moved = np.array([place[tuple(column)] for column in columns[:, order].tolist()])
        images.append(np.sort(moved[chosen], axis=1) @ digits)
    return np.asarray(np.min(images, axis=0) == chosen @ digits)


def _full_rank(patterns: Signs) -> NDArray[np.bool_]:
    """(K,) whether some magnitudes give rank n. The rows are scaled to A 1 = 0, which any column scaling permits.

    Random magnitudes reach the greatest possible rank, except on a set of measure zero.
    """
    sizes = np.random.default_rng(0).uniform(0.5, 2.0, patterns.shape)
    positive, negative = sizes * (patterns > 0), sizes * (patterns < 0)
    balanced = positive / positive.sum(2, keepdims=True) - negative / negative.sum(2, keepdims=True)
    return np.asarray(np.linalg.matrix_rank(balanced) == patterns.shape[1])
