"""The interior point method behind the active set: a guess of the active bounds from inside, which cannot cycle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mpc.programme import Programme


def guess_from_inside(programme: Programme) -> None:
    """Set the bounds that hold at the solution of a programme, to within the last digits.

    The primal-dual method with a barrier (Wright, "Primal-dual interior-point methods", 1997): with the torques x
    counted from the middle between their bounds, half widths h and multipliers l and u,

        l (h + x) = u (h - x) = target,    derivative of the cost = l - u

    is solved by Newton's method for a target that shrinks, each step one Riccati sweep, stopped short of the bounds.
    """
    low, high = programme.bounds[:, 1], programme.bounds[:, 2]
    programme.bounds[:, 0] = 0.0
    programme.sweep()
    middle = (low + high) / 2
    half = np.maximum((high - low) / 2, 1e-7 * programme.unit[0])
    curvature = programme.law[:, -1].copy()
    most = float(np.max(curvature * np.maximum(np.abs(programme.e - middle), half)))
    x, lower, upper, centring = np.zeros(low.size), np.full(low.size, most), np.full(low.size, most), 0.1
    for _ in range(programme.rounds):
        left, right = half + x, half - x
        mean = float(lower @ left + upper @ right) / (2 * low.size)
        if not mean > 1e-12 * most * programme.unit[0]:
            break
        target = centring * mean
        d = lower / left + upper / right
        programme.data[:, 2] = d
        programme.data[:, 3] = -d * (middle + x) - target / left + target / right
        programme.sweep()
        change = programme.e - middle - x
        down = target / left - lower - lower / left * change
        up = target / right - upper + upper / right * change
        room = np.concatenate((left, right, lower, upper))
        taken = np.concatenate((-change, change, -down, -up))
        length = min(1.0, 0.995 * float(np.min(room / np.maximum(taken, 1e-300))))
        x, lower, upper = x + length * change, lower + length * down, upper + length * up
        centring = max(0.01, (1.0 - length) ** 2)
    push = (lower - upper) / curvature
    programme.bounds[:, 0] = np.where(x - push < -half, -1.0, np.where(x - push > half, 1.0, 0.0))
    programme.data[:, 2:] = 0.0
