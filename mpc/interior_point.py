"""The interior point method, used after the active set: it cannot cycle, and includes all intervals of a program."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mpc.riccati_sweeps import Sweeps

Array = NDArray[np.float64]

_BEGIN, _CLOSE = 1e3, 1e-9
"""Initial complementarity products, in units of the greatest force times the greatest torque, and final tolerance.

The tolerance does not apply to the products: near the greatest penalty of a limit the sweeps lose precision before the
products are small.
"""

_STIFF = 1e11
"""Greatest curvature of the barrier, in units of that of the cost: above it the forces would be rounding errors."""


@np.errstate(all="ignore")  # an infinite price marks an interval that cannot be left
def solve_from_inside(program: Sweeps) -> None:
    """Solve a program almost to machine precision, and determine from the solution which torques are at a bound.

    The primal-dual barrier method (Wright, "Primal-dual interior-point methods", 1997). The end b of an interval, with
    sign + or -, acts on a quantity q of a stage by a force (multiplier). For a soft interval with a price and an
    excess, the force stays below the price:

        slack = sign (b - q) + excess,    slack force = target,    excess (price - force) = target,
        derivative of the cost = - sum sign force

    Newton's method with a decreasing target; each step is one Riccati sweep and stays strictly inside. The sweep
    computes the change from the last point and not from zero: near the solution the barrier is so steep that the
    difference of two large numbers would be rounding error.
    """
    p, unit = program, float(program.unit[0])
    low, high = p.bounds[:, 1], p.bounds[:, 2]
    kept = p.data.copy(), p.end.copy()
    p.bounds[:, 0] = 0.0
    p.sweep()
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-7 * unit)
    p.curvature[:] = p.law[:, -1]
    most = float(np.max(p.curvature * np.maximum(np.abs(p.e - middle), half)))
    p.fence[:, 0] = np.stack((middle - half, middle + half), axis=-1)
    p.follow(middle)
    x = middle.copy()
    _begin_here(p, 1.0)

    ends = p.fence.ravel()
    at = np.flatnonzero(np.abs(ends) < np.inf)
    row, sign = at // 2, np.where(at % 2, 1.0, -1.0)
    stages = p.e.size
    price, moved = np.tile(p.prices, stages)[row], np.tile(p.moved, stages)[row]
    priced, weight = price < np.inf, float(p.rate_weight[0])
    far, strong = 1.0 / (unit * moved), moved / (unit * weight)  # scaling of slacks and of forces
    stiffest = _STIFF * (p.curvature[row // p.rows] / (moved * moved))
    slack_of_bound = sign * (ends[at] - p.numbers()[row])
    least = np.where(row % p.rows == 0, 0.0, unit * moved)  # a torque starts in the middle of its interval
    slack, force, violation, spare = _centred(slack_of_bound, price, least, _BEGIN * most * unit)
    centring, count = 0.1, at.size + int(np.sum(priced))
    for _ in range(p.rounds):
        products = slack * force + np.where(priced, violation * spare, 0.0)
        mean = float(np.cumsum(np.append(0.0, products))[-1]) / max(count, 1)
        wide = np.where(priced, np.minimum(violation * far, spare * strong), 0.0)
        if not np.max([np.minimum(slack * far, force * strong), wide], initial=0.0) > _CLOSE:
            break
        target = centring * mean
        stiff = np.minimum(1.0 / (slack / force + violation / spare), stiffest)
        pull = stiff * (target / force - target / spare - slack_of_bound)
        p.barrier[:, 0::2] = _sums(p, row, stiff)
        p.barrier[:, 1::2] = _sums(p, row, sign * (force + pull))
        p.sweep()
        nearer = sign * p.numbers()[row]
        harder = pull + stiff * nearer
        wider = target / force - slack - slack / force * harder
        farther = target / spare - violation + violation / spare * harder
        room, taken = (
            np.concatenate((slack, force, violation, spare)),
            -np.concatenate((wider, harder, farther, -harder)),
        )
        length = min(1.0, 0.995 * float(np.min(room[taken > 0.0] / taken[taken > 0.0], initial=np.inf)))
        slack, force, violation = slack + length * wider, force + length * harder, violation + length * farther
        slack_of_bound, spare, x = slack_of_bound - length * nearer, spare - length * harder, x + length * p.e
        centring = max(0.01, (1.0 - length) * (1.0 - length))
        _begin_here(p, length)
    p.barrier[:] = 0.0
    p.data[:], p.end[:] = kept
    p.follow(x)
    p.forces[:] = _sums(p, row, sign * force)
    given_up = priced & (violation * far > spare * strong)
    size = np.where(given_up, 2.0, np.where(slack * far < force * strong, 1.0, 0.0)) * (row % p.rows > 0)
    pushes, standing = np.zeros((p.forces.size, 2)), np.zeros((p.forces.size, 2))
    end = (sign > 0).astype(np.intp)
    pushes[row, end], standing[row, end] = force, sign * size
    p.pressed[:] = np.where(pushes[:, 1] > pushes[:, 0], standing[:, 1], standing[:, 0]).reshape(p.pressed.shape)
    push, inside = p.forces[:, 0] / p.curvature, x - middle
    p.bounds[:, 0] = np.where(inside + push < -half, -1.0, np.where(inside + push > half, 1.0, 0.0))


def _begin_here(program: Sweeps, length: float) -> None:
    """Shift the origin of the program by the given share of the last sweep."""
    p = program
    p.data[:, 0] += length * p.s[:-1, 0]
    p.data[:, 1] += length * (p.e - p.s[:-1, -1])
    p.end += length * p.s[-1, :2]


def _centred(slack_of_bound: Array, price: Array, least: Array, start: float) -> tuple[Array, Array, Array, Array]:
    """Slack, force, excess and spare force with both products equal to `start`; soft intervals also match the gap."""
    hard = start / np.maximum(slack_of_bound, least)
    complementarity = np.where(price < np.inf, slack_of_bound * price, 0.0)
    total = complementarity + 2 * start + np.sqrt(complementarity * complementarity + 4 * start * start)
    force = np.where(price < np.inf, 2 * start * (price / total), hard)
    spare = np.where(price < np.inf, price - force, np.inf)
    return start / force, force, np.where(price < np.inf, start / spare, 0.0), spare


def _sums(program: Sweeps, row: NDArray[np.int64], values: Array) -> Array:
    """(N, rows) sums over both ends of each interval, zero where there is none."""
    return np.bincount(row, values, program.forces.size).astype(np.float64).reshape(program.forces.shape)
