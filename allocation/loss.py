"""Drives that give no torque any more: which of the others can still hold the teeth together."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from allocation.structure import Structure

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def still_preloaded(structure: Structure, lost: tuple[int, ...]) -> Flags:
    """(m,) which drives can still be preloaded when those of the given numbers (from 1) are lost.

    A drive can be preloaded if the others hold against it: if some v >= 0 with B v = 0 over the living drives has
    v_i > 0. Such v add up, so one linear program finds all of them at once,

        maximise sum t   subject to   B v = 0,  v >= t,  0 <= t <= 1,  v = 0 for the lost drives

    because v may be as large as it takes: t_i is 1 where it can be positive at all, and 0 elsewhere.
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
    """What the loss of some of the drives costs, where `preloaded` tells which still hold a preload."""
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
