"""Random redundant-drive machines, and what the allocator must answer on them, found by trying everything."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from allocation import Allocator, admissible

Array = NDArray[np.float64]


def admissible_matrix(rng: np.random.Generator, n: int, m: int) -> Array:
    """A random admissible structure (n, m), some of its entries zero, not too close to the edge."""
    while True:
        A = rng.normal(size=(n, m)) * (rng.uniform(size=(n, m)) < 0.8)
        if admissible(A).score > 0.01:
            return np.asarray(A)


def best_by_trying(B: Array, torque: Array, lower: Array, upper: Array, weights: Array) -> Array:
    """The box's point whose B x is nearest to a torque, with the least effort of all such points.

    Every set of active bounds is tried: 3^m of them. Its free drives take the least-squares solution of least effort.
    """
    m, best, found = B.shape[1], (np.inf, np.inf), lower
    root = np.sqrt(weights)
    for held in product((-1, 0, 1), repeat=m):
        sides = np.array(held)
        x = np.where(sides < 0, lower, upper)
        free = sides == 0
        x[free] = np.linalg.pinv(B[:, free] / root[free], rcond=1e-9) @ (torque - B[:, ~free] @ x[~free]) / root[free]
        if np.all(x >= lower - 1e-12) and np.all(x <= upper + 1e-12):
            miss, effort = float(np.linalg.norm(B @ x - torque)), float(weights @ x**2)
            if miss < best[0] - 1e-12 or (miss < best[0] + 1e-12 and effort < best[1]):
                best, found = (min(miss, best[0]), effort), x
    return found


def random_allocator(rng: np.random.Generator, n: int, m: int, scale: float = 1.0) -> Allocator:
    """Drives of all kinds on a random structure; torques of the order of `scale` [N m]."""
    least = rng.uniform(0, 0.4, m)
    return Allocator(
        admissible_matrix(rng, n, m),
        min_torque=tuple(scale * least),
        max_torque=tuple(scale * (least + rng.uniform(0.1, 0.6, m))),
        weights=tuple(10 ** rng.uniform(-1, 1, m)),
        rotor_inertia=tuple(scale * rng.uniform(0, 0.1, m)),
        motor_friction=tuple(scale * rng.uniform(0, 0.02, m)),
    )
