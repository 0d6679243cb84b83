"""Results of a plan: drive torques over the horizon, predicted motion, and margin of contact.

See plan_ahead and hold in step.c.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from mpc.prepared import prepared
from mpc.slots import Soft, Tuning
from mpc.stage_allocation import allocation


def outcome(
    n: int, limited: bool, plan: Any, rub: Any, states: Any, s: Any, preload: Any, allocation_numbers: Any, **known: Any
) -> dict[str, Any]:
    """The results as expressions by name.

    Angles (N + 1,), accelerations (N,) and torques (2N,); load torque and preload of the present sample; the smallest
    margin, the present drive output torque, whether all values are finite, and whether the plan violates a limit.
    """
    N, m, tuning = rub.numel(), n + 1, known["tuning"]
    late = states.numel() // n - N - 1
    course = [(states[n * (late + k)] + s[m * k], states[n * (late + k) + 1] + s[m * k + 1]) for k in range(N + 1)]
    acceleration = [(course[k + 1][1] - course[k][1]) / known["model"][-1] for k in range(N)]
    sound, beyond = ca.MX(1), ca.MX(0)
    for value in (*acceleration, *ca.vertsplit(plan), *ca.vertsplit(rub)):
        sound = ca.logic_and(sound, ca.fabs(value) < np.inf)
    if limited:
        for angle, speed in course[1:]:
            beyond = ca.logic_or(beyond, _broken(angle, speed, known["soft"]))
    one, margin, torques, after, given = prepared(allocation()).function, ca.MX(np.inf), [], [preload], []
    for k in range(N):
        wanted, speed = plan[k + 1] + rub[k], states[n * (late + k) + 1]
        last, pair, put_out, left = one(after[-1], wanted, speed, acceleration[k], allocation_numbers)
        after.append(last)
        torques.append(pair)
        given.append(put_out)
        margin = ca.if_else(left < margin, left, margin)
    load = plan[1] + rub[0] - tuning[Tuning.INERTIA] * acceleration[0]
    found = {"angles": ca.vertcat(*(angle for angle, _ in course)), "acceleration": ca.vertcat(*acceleration)}
    found |= {"torques": ca.vertcat(*torques), "sound": sound, "beyond": beyond, "margin": margin}
    return found | {"load": load, "preload": after[1], "given": given[0]}


def holding(preload: Any, allocation_numbers: Any, plan: Any) -> dict[str, Any]:
    """Expressions by name for N samples with torques that keep contact with as little output torque as possible."""
    one, after = prepared(allocation()).function, preload
    torques: list[Any] = []
    first: list[Any] = []
    for _ in range(plan.numel() - 1):
        after, pair, given, margin = one(after, 0, 0, 0, allocation_numbers)
        torques.append(pair)
        first = first or [after, given, margin]
    preload, given, margin = first
    return {"torques": ca.vertcat(*torques), "preload": preload, "given": given, "margin": margin}


def _broken(angle: Any, speed: Any, soft: Any) -> Any:
    """Whether a limit of angle or speed is violated by more than noise."""
    low, high = soft[Soft.LOWEST] - soft[Soft.SHOWS], soft[Soft.HIGHEST] + soft[Soft.SHOWS]
    too_fast = ca.fabs(speed) > soft[Soft.FASTEST] + soft[Soft.SHOWS_SPEED]
    return ca.logic_or(ca.logic_or(angle < low, angle > high), too_fast)
