"""What the reference will be: beyond a single number, and beyond the horizon."""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@cache
def preview() -> Any:
    """The speed of a caller who only tells the wanted angle of now, as a `casadi.Function`.

    (numbers (4,): how many angles are remembered, and the last three; angle, attainable) -> numbers, change of angle
    from sample to sample. A number goes on at its speed if it has been moving smoothly: by no more than `attainable`
    beside a straight line, which is what the machine could follow.
    """
    numbers, angle, tuning = ca.SX.sym("numbers", 4), ca.SX.sym("angle"), ca.SX.sym("attainable")
    count = ca.fmin(numbers[0] + 1, 3)
    first, second = numbers[2], numbers[3]
    smooth = ca.logic_and(count == 3, ca.fabs(angle - 2 * second + first) <= tuning)
    speed = ca.if_else(smooth, angle - second, 0)
    return ca.Function("preview", [numbers, angle, tuning], [ca.vertcat(count, first, second, angle), speed])


def prolonged(path: Array, count: int) -> Array:
    """A path (M,), at least three samples, with `count` more: it goes on at its last acceleration.

    At its last speed alone it would fall behind a reference that bends, and drag the end of the plan with it.
    """
    speed = path[-1] - path[-2]
    bend = speed - (path[-2] - path[-3])
    k = np.arange(1, count + 1)
    return np.append(path, path[-1] + speed * k + bend * k * (k + 1) / 2)
