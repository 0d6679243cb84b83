"""The active set: Newton steps until the bounds and ends that are active repeat, begun where the last sample ended.

A torque is held at its bound by the sweep itself. Another number of a stage is held at the end b of its interval by a
force f, which Newton's method on the augmented Lagrangian finds: a sweep under

    f (q - b) + rho/2 (q - b)^2,    then    f + rho (q - b)  is the new force

with so great a rho that one sweep has it right to the digits that are asked for. A force that would pull lets its
number go; one that would cost more than the price of leaving the interval stays at that price, until the number comes
back. The number that is farthest out is held next, one in each round: limits that are held one behind the other would
else be more than the torques can meet. Nothing here is believed without `Sweeps.residual`, and where it does not come
to an end, the interior point method is behind it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mpc.riccati import TORQUE_ALONE
from mpc.sweeps import Sweeps

Array = NDArray[np.float64]

TRIES = 15
"""Rounds with other numbers than the torque, after which the interior point method is the shorter way."""

_CLOSE = 1e-9
"""How near to its end a number is that is held there, and how far beyond one that need not be: in torque that moves it,
in units of the greatest. With the price of an interval more would show in the cost."""

FIRM = 1e4
"""rho, in units of the curvature of the cost: what a number is beyond its end, and what a force lacks, is as little."""


@np.errstate(all="ignore")  # forgotten numbers may be anything; what comes of them is certified
def find_active_set(program: Sweeps) -> bool:
    """Let the bounds and ends of a program settle; whether they do. The last sweep then is the solution."""
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
            continue  # the first sweep was for the curvature alone
        warm = False
        p.bounds[:, 0] = p.held
        if fenced:
            far = _beyond(p)
            changes = _settle(p) or changes
            taken = _take_up(p, far)
            changes, pressing = changes or taken, pressing or taken
            once_more = not changes and pressing and not once_more  # with forces that are right by now
            changes = changes or once_more
    p.barrier[:] = 0.0
    return not changes


def _ends(program: Sweeps) -> Array:
    """(N, rows) the end at which each number is held, the lower one of those that are not."""
    return np.where(program.pressed > 0, program.fence[:, :, 1], program.fence[:, :, 0])


def _steepness(program: Sweeps) -> Array:
    return np.asarray(FIRM * (program.curvature[:, None] / (program.moved * program.moved)))


def _known(program: Sweeps) -> bool:
    """Keep of what is remembered what can be; whether anything is."""
    p = program
    at, price = np.abs(p.pressed), p.prices
    given_up = (at == 2) & (price < np.inf)
    p.forces[:] = np.where(given_up, np.where(p.pressed > 0, price, -price), p.forces)
    keep = (np.abs(_ends(p)) < np.inf) & (((at == 1) & (np.abs(p.forces) < np.inf)) | given_up)
    keep[:, 0] = False
    p.pressed[~keep] = p.forces[~keep] = 0.0
    return bool(keep.any())


def _press(program: Sweeps) -> None:
    """What is held, or given up, adds to the cost."""
    p = program
    held = np.abs(p.pressed) == 1
    firm = np.where(held, _steepness(p), 0.0)
    p.barrier[:, 0::2] = firm
    p.barrier[:, 1::2] = np.where(held, p.forces - firm * np.where(held, _ends(p), 0.0), p.forces)


def _settle(program: Sweeps) -> bool:
    """The forces behind a sweep, and which numbers are let go, given up to their price, or held again; whether any."""
    p = program
    at, sense = p.pressed.copy(), np.where(p.pressed > 0, 1.0, -1.0)
    beyond = sense * (p.numbers().reshape(at.shape) - _ends(p))
    force = sense * p.forces + _steepness(p) * beyond
    held = np.abs(at) == 1
    back = (np.abs(at) == 2) & (beyond < 0)
    gone, dear = held & ~(force > 0), held & (force > p.prices)
    p.pressed[:] = np.where(gone, 0.0, np.where(dear, 2 * sense, np.where(back, sense, at)))
    settled = sense * np.where(gone, 0.0, np.where(dear, p.prices, force))
    p.forces[:] = np.where(held, settled, p.forces)
    away = held & (np.abs(beyond) > _CLOSE * p.unit[0] * p.moved)  # not quite there
    return bool((gone | dear | back | away).any())


def _beyond(program: Sweeps) -> Array:
    """(N, rows) how far each number that is free is beyond an end, in units of the torque that moves it."""
    p = program
    q = p.numbers().reshape(p.pressed.shape)
    far = np.maximum(q - p.fence[:, :, 1], p.fence[:, :, 0] - q) / p.moved
    far[:, 0] = -np.inf
    far[p.pressed != 0] = -np.inf
    return far


def _take_up(program: Sweeps, far: Array) -> bool:
    """Hold those that are farther beyond than their neighbours in time; whether there are any."""
    p, edge = program, np.full((1, far.shape[1]), -np.inf)
    peak = (far >= np.vstack((edge, far[:-1]))) & (far > np.vstack((far[1:], edge)))
    taken = (far > _CLOSE * p.unit[0]) & peak
    upper = p.numbers().reshape(far.shape) > p.fence[:, :, 1]
    p.pressed[taken] = np.where(upper, 1.0, -1.0)[taken]
    return bool(taken.any())
