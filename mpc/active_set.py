"""Active-set method: Newton steps until the active constraints repeat, warm-started from the previous sample.

The sweep itself holds a torque at its bound. Another constrained quantity q of a stage is held at the end b of its
interval by a multiplier (force) f, found by Newton's method on the augmented Lagrangian: one sweep with the cost terms

    f (q - b) + rho/2 (q - b)^2,    then the new force is    f + rho (q - b)

rho is so large that one sweep reaches the required precision. A quantity is released if its force has the wrong sign.
A force above the price of the soft limit stays at that price until the quantity is back inside the interval. In each
round the local maxima over time of the constraint violation are added to the active set: adding all violated samples
at once can give an infeasible set. `Sweeps.residual` certifies the result. If the method does not converge, the
interior point method solves the program.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mpc.riccati import TORQUE_ALONE
from mpc.riccati_sweeps import Sweeps

Array = NDArray[np.float64]

TRIES = 15
"""Rounds with constraints other than the torque bounds; after these the interior point method is faster."""

_CLOSE = 1e-9
"""Tolerance of an active constraint and of a violation, as the torque that causes it, in units of the greatest torque.
Multiplied by the price of a soft limit, a larger tolerance would change the cost noticeably."""

FIRM = 1e4
"""rho, in units of the curvature of the cost: it reduces constraint violation and force error by this factor."""


@np.errstate(all="ignore")  # unused entries may have any value; the result is certified
def find_active_set(program: Sweeps) -> bool:
    """Iterate the active set of a program; returns whether it converges. The last sweep is then the solution."""
    p = program
    fenced, changes, once_more = p.rows > TORQUE_ALONE, True, False
    pressing = warm = fenced and _known(p)
    p.barrier[:] = 0.0
    for place in range(min(p.rounds, TRIES) if fenced else p.rounds):
        if not (changes or warm):
            break
        if fenced and place:
            _press(p)
        changes = not p.sweep()
        if not (fenced and place):
            p.curvature[:] = p.law[:, -1]
        if warm and not place:
            continue  # the first sweep only gives the curvature
        warm = False
        p.bounds[:, 0] = p.held
        if fenced:
            far = _beyond(p)
            changes = _settle(p) or changes
            taken = _take_up(p, far)
            changes, pressing = changes or taken, pressing or taken
            once_more = not changes and pressing and not once_more  # one more sweep with the converged forces
            changes = changes or once_more
    p.barrier[:] = 0.0
    return not changes


def _ends(program: Sweeps) -> Array:
    """(N, rows) the end of the interval at which each quantity is held; the lower end for free ones."""
    return np.where(program.pressed > 0, program.fence[:, :, 1], program.fence[:, :, 0])


def _steepness(program: Sweeps) -> Array:
    return np.asarray(FIRM * (program.curvature[:, None] / (program.moved * program.moved)))


def _known(program: Sweeps) -> bool:
    """Keep the valid part of the previous active set; returns whether any of it is left."""
    p = program
    at, price = np.abs(p.pressed), p.prices
    given_up = (at == 2) & (price < np.inf)
    p.forces[:] = np.where(given_up, np.where(p.pressed > 0, price, -price), p.forces)
    keep = (np.abs(_ends(p)) < np.inf) & (((at == 1) & (np.abs(p.forces) < np.inf)) | given_up)
    keep[:, 0] = False
    p.pressed[~keep] = p.forces[~keep] = 0.0
    return bool(keep.any())


def _press(program: Sweeps) -> None:
    """Add the cost terms of the held quantities and of those at their price."""
    p = program
    held = np.abs(p.pressed) == 1
    firm = np.where(held, _steepness(p), 0.0)
    p.barrier[:, 0::2] = firm
    p.barrier[:, 1::2] = np.where(held, p.forces - firm * np.where(held, _ends(p), 0.0), p.forces)


def _settle(program: Sweeps) -> bool:
    """Update forces and active set (release, put at the price, hold again); returns whether anything changed."""
    p = program
    at, direction = p.pressed.copy(), np.where(p.pressed > 0, 1.0, -1.0)
    beyond = direction * (p.numbers().reshape(at.shape) - _ends(p))
    force = direction * p.forces + _steepness(p) * beyond
    held = np.abs(at) == 1
    back = (np.abs(at) == 2) & (beyond < 0)
    gone, dear = held & ~(force > 0), held & (force > p.prices)
    p.pressed[:] = np.where(gone, 0.0, np.where(dear, 2 * direction, np.where(back, direction, at)))
    settled = direction * np.where(gone, 0.0, np.where(dear, p.prices, force))
    p.forces[:] = np.where(held, settled, p.forces)
    away = held & (np.abs(beyond) > _CLOSE * p.unit[0] * p.moved)  # not yet within tolerance
    return bool((gone | dear | back | away).any())


def _beyond(program: Sweeps) -> Array:
    """(N, rows) violation of each free quantity, as the torque that causes it."""
    p = program
    q = p.numbers().reshape(p.pressed.shape)
    far = np.maximum(q - p.fence[:, :, 1], p.fence[:, :, 0] - q) / p.moved
    far[:, 0] = -np.inf
    far[p.pressed != 0] = -np.inf
    return far


def _take_up(program: Sweeps, far: Array) -> bool:
    """Hold the quantities whose violation is a local maximum over time; returns whether there are any."""
    p, edge = program, np.full((1, far.shape[1]), -np.inf)
    peak = (far >= np.vstack((edge, far[:-1]))) & (far > np.vstack((far[1:], edge)))
    taken = (far > _CLOSE * p.unit[0]) & peak
    upper = p.numbers().reshape(far.shape) > p.fence[:, :, 1]
    p.pressed[taken] = np.where(upper, 1.0, -1.0)[taken]
    return bool(taken.any())
