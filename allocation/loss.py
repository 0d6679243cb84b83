"""Loss of drives: which of the remaining drives can still be preloaded."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from allocation.structure import Structure

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def still_preloaded(structure: Structure, lost: tuple[int, ...]) -> Flags:
    """(m,) which drives can still be preloaded when those of the given numbers (from 1) are lost.

    Drive i can be preloaded if a v >= 0 of the remaining drives exists with B v = 0 and v_i > 0. The sum of two such v
    is another one, so one linear program finds all such drives:

        maximise sum t   subject to   B v = 0,  v >= t,  0 <= t <= 1,  v = 0 for the lost drives

    v may have any size, so t_i = 1 if v_i can be positive, and t_i = 0 otherwise.
    """
    from scipy.optimize import linprog

    n, m = structure.matrix.shape
    alive = np.ones(m)
    alive[[number - 1 for number in lost]] = 0.0
    size = np.linalg.norm(structure.pushing, axis=1, keepdims=True)
    answer = linprog(
        np.append(np.zeros(m), -np.ones(m)),
        A_ub=np.hstack((-np.eye(m), np.eye(m))),
        b_ub=np.zeros(m),
        A_eq=np.hstack((structure.pushing / size, np.zeros((n, m)))),
        b_eq=np.zeros(n),
        bounds=[*((0.0, None if a else 0.0) for a in alive), *((0.0, a) for a in alive)],
        method="highs",
    )
    return np.asarray(answer.x[m:] > 0.5) if answer.x is not None else np.zeros(m, dtype=bool)


def loss(lost: Flags, preloaded: Flags) -> Iterator[str]:
    """Messages about the lost drives and their consequence; `preloaded`: which drives can still be preloaded."""
    if not np.any(lost):
        return
    gone, bare = _are(lost), ~lost & ~preloaded
    if not np.any(preloaded):
        yield f"{gone} lost, and backlash control with it"
    elif np.any(bare):
        yield f"{gone} lost, and the backlash control of {_are(bare).rsplit(' ', 1)[0]} with it"
    else:
        yield f"{gone} lost, the others still keep contact"


def _are(drives: Flags) -> str:
    """Subject and verb: "drive 2 is", "drives 2 and 4 are"."""
    numbers = [str(i + 1) for i in np.flatnonzero(drives)]
    if len(numbers) == 1:
        return f"drive {numbers[0]} is"
    return f"drives {', '.join(numbers[:-1])} and {numbers[-1]} are"
