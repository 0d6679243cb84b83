"""Extrapolation of the reference: of a scalar over the horizon, and of a path beyond the horizon."""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca

from mpc.slots import History


@cache
def preview() -> Any:
    """Estimated speed of a scalar reference, as a `casadi.Function`.

    (memory (4,), see `mpc.slots.History`; angle, attainable) -> memory, change of the angle per sample. The reference
    is extrapolated at its speed if its motion is smooth, otherwise the speed is zero. It is smooth if its second
    difference is at most `attainable`, so that the machine can follow.
    """
    history, angle, attainable = ca.SX.sym("history", len(History)), ca.SX.sym("angle"), ca.SX.sym("attainable")
    count = ca.fmin(history[History.COUNT] + 1, 3)
    first, second = history[History.SECOND], history[History.THIRD]
    smooth = ca.logic_and(count == 3, ca.fabs(angle - 2 * second + first) <= attainable)
    speed = ca.if_else(smooth, angle - second, 0)
    return ca.Function("preview", [history, angle, attainable], [ca.vertcat(count, first, second, angle), speed])


def prolonged(path: Any, count: int) -> Any:
    """A path of at least three samples, as expressions, extrapolated by `count` samples at its last acceleration.

    With constant speed it would lag behind an accelerating reference and distort the end of the plan.
    """
    last = path.numel() - 1
    speed = path[last] - path[last - 1]
    acceleration = speed - (path[last - 1] - path[last - 2])
    return ca.vertcat(path, *(path[last] + speed * k + acceleration * k * (k + 1) / 2 for k in range(1, count + 1)))
