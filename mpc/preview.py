"""What the reference will be: beyond a single number, and beyond the horizon."""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca

from mpc.slots import Told


@cache
def preview() -> Any:
    """The speed of a caller who only tells the wanted angle of now, as a `casadi.Function`.

    (what was told (4,), see `mpc.slots.Told`; angle, attainable) -> what was told, change of angle from sample to
    sample. A number goes on at its speed if it has been moving smoothly: by no more than `attainable`
    beside a straight line, which is what the machine could follow.
    """
    told, angle, attainable = ca.SX.sym("told", len(Told)), ca.SX.sym("angle"), ca.SX.sym("attainable")
    count = ca.fmin(told[Told.COUNT] + 1, 3)
    first, second = told[Told.SECOND], told[Told.THIRD]
    smooth = ca.logic_and(count == 3, ca.fabs(angle - 2 * second + first) <= attainable)
    speed = ca.if_else(smooth, angle - second, 0)
    return ca.Function("preview", [told, angle, attainable], [ca.vertcat(count, first, second, angle), speed])


def prolonged(path: Any, count: int) -> Any:
    """A path of expressions, at least three samples, with `count` more: it goes on at its last acceleration.

    At its last speed alone it would fall behind a reference that bends, and drag the end of the plan with it.
    """
    last = path.numel() - 1
    speed = path[last] - path[last - 1]
    bend = speed - (path[last - 1] - path[last - 2])
    return ca.vertcat(path, *(path[last] + speed * k + bend * k * (k + 1) / 2 for k in range(1, count + 1)))
