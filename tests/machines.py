"""Random redundant-drive machines, and what the allocator must answer on them, found by trying everything."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from allocation import Allocation, Allocator, admissible
from plant.gears import GearTrain

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


def two_drives(rng: np.random.Generator, scale: float) -> Allocator:
    """Any gear train with drives of any kind; rated torque of the order of `scale` [N m]."""
    gears = GearTrain(
        pinion_teeth=(int(rng.integers(8, 200)), int(rng.integers(8, 200))), output_teeth=int(rng.integers(8, 400))
    )
    most = rng.uniform(0.2, 1.0, 2)
    inertia = rng.uniform(0.0, 0.2) / float(np.max(gears.mesh_ratios))
    return Allocator(
        gears,
        min_torque=tuple(scale * most * rng.uniform(0.0, 0.9, 2)),
        max_torque=tuple(scale * most),
        weights=tuple(10 ** rng.uniform(-1, 1, 2)),
        rotor_inertia=scale * inertia,
        motor_friction=scale * rng.uniform(0.0, 0.02),
        torque_rate=scale * 10 ** rng.uniform(0, 3),
        preload_rate=scale * 10 ** rng.uniform(0, 3),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Ask:
    """One call of the allocator: `allocator.allocate(ask.torque, ask.acceleration, before=ask.before, dt=DT)`."""

    torque: float
    acceleration: float
    before: Allocation | None


DT = 0.005


def requests(rng: np.random.Generator, allocator: Allocator, count: int) -> list[Ask]:
    """Demands within reach, out of reach and at its very edge; half of them from where an earlier one had led."""
    found, before = [], allocator.at_rest()
    for _ in range(count):
        a = float(rng.uniform(-3.0, 3.0))
        low, high = allocator.bounds.reachable(a)
        share = float(rng.choice([rng.uniform(-0.2, 1.2), 0.0, 1.0], p=[0.9, 0.05, 0.05]))
        ask = Ask(
            torque=float(low + share * (high - low)), acceleration=a, before=before if rng.random() < 0.5 else None
        )
        before = allocator.allocate(ask.torque, a, before=before, dt=DT)
        found.append(ask)
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
