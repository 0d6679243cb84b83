"""Feedforward: the torque that the governed reference requires, without cost in the program.

The weight on torque changes limits the bandwidth of the loop as its margins require. The torque for a reference that
the model can follow is known in advance, so only changes relative to this feedforward torque have a cost. With a
correct model the load follows at any bandwidth; the loop only has to compensate disturbances and model errors.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca

from mpc.filter import finite
from mpc.slots import Fed, Kalman, Rubbing
from plant.effects import Moment
from plant.servo import ServoModel


def demand(model: ServoModel) -> Any:
    """The torque that the reference requires during a sample, as a `casadi.Function`.

    (governed angle, its speed during the sample and the next one (2,), last change of speed, parameters) -> torque on
    the rigid load without dry friction and without effects that have states; change of the speed. Speeds are used
    because differences of angles lose all digits in single precision.
    """
    angle, speeds, before = ca.SX.sym("angle"), ca.SX.sym("speeds", 2), ca.SX.sym("before")
    p = ca.SX.sym("p", len(model.names) + 1)
    bound, dt = model.bound(p[:-1]), p[-1]
    velocity_change = speeds[1] - speeds[0]
    at = Moment(angle=angle + dt * speeds[0] / 2, velocity=speeds[0], inertia=bound.inertia)
    still = [effect for effect in bound.effects if not effect.states]
    inertia = bound.inertia + sum(effect.added_inertia(at) for effect in still)
    passive = bound.gravity * ca.cos(at.angle) + bound.viscous_friction * at.velocity
    torque = (
        inertia * (velocity_change + before) / (2 * dt) + passive - sum(effect.load_torque(at, 0.0) for effect in still)
    )
    return ca.Function("demand", [angle, speeds, before, p], [torque, velocity_change], {"cse": True})


@cache
def ease() -> Any:
    """One sample of the smoothing of the feedforward torque, as a `casadi.Function`.

    (required torque, smoothed torque of the sample before and its last change (2,), numbers of friction) -> smoothed
    torque and its change (2,). Smooth motion is not altered. Where the acceleration jumps, the change of the torque
    grows per sample by at most `Rubbing.QUIET`, up to `Rubbing.MOST_CHANGE`; this suppresses the noise of a reference.
    It is applied forward and backward in time, and the mean of both has no delay. It is applied forward once more to
    that mean, which also limits the effect of a jump without preview.
    """
    before, taken, rubbing = ca.SX.sym("before", 2), ca.SX.sym("taken"), ca.SX.sym("rubbing", len(Rubbing))
    (torque, change), most, quiet = ca.vertsplit(before), rubbing[Rubbing.MOST_CHANGE], rubbing[Rubbing.QUIET]
    up, down = ca.fmin(ca.fmax(change, 0) + quiet, most), ca.fmax(ca.fmin(change, 0) - quiet, -most)
    more = ca.fmax(ca.fmin(taken - torque, up), down)
    return ca.Function("ease", [taken, before, rubbing], [ca.vertcat(torque + more, more)], {"cse": True})


def fed_forward(
    demand: Any, late: int, ahead: Any, speeds: Any, fed: Any, past: Any, kalman: Any, model: Any, rubbing: Any
) -> dict[str, Any]:
    """The torque required by the governed reference, and the feedforward torque, as expressions.

    The feedforward of the sample before the first one is the acting torque. See feed_forward in step.c.
    """
    path, rates, N = ahead[late:], speeds[late:], ahead.numel() - late - 2
    velocity_change = rates[1] - rates[0]
    known = ca.logic_and(fed[Fed.KNOWN] == 1, finite(fed[Fed.VELOCITY_CHANGE :]))
    first, _ = demand(path[0], rates[:2], -velocity_change, model)
    anew = ca.vertcat(velocity_change, first, 0, first, 0)
    before = ca.if_else(known, fed[Fed.VELOCITY_CHANGE :], anew)
    acts = past[late + 1] + kalman[Kalman.DISTURBANCE]
    velocity_changes = [before[0], *(rates[k] - rates[k - 1] for k in range(1, N))]
    taken = [demand(path[k], rates[k : k + 2], velocity_changes[k], model)[0] for k in range(N)]
    there = _smoothed(taken, before[1:3], rubbing)
    back = _smoothed(taken[::-1], ca.vertcat(taken[-1], taken[-2] - taken[-1]), rubbing)[::-1]
    both = [(forward[0] + backward[0]) / 2 for forward, backward in zip(there, back, strict=True)]
    eased = _smoothed(both, before[3:5], rubbing)
    feed = ca.vertcat(ca.if_else(known, fed[Fed.TORQUE], acts), *(torque[0] for torque in eased))
    return {"fed": ca.vertcat(1, velocity_change, there[0], eased[0]), "feed": feed, "taken": ca.vertcat(*taken)}


def _smoothed(torques: list[Any], before: Any, rubbing: Any) -> list[Any]:
    """Smoothed torque and its change (2,) of each sample."""
    found = []
    for torque in torques:
        before = ease()(torque, before, rubbing)
        found.append(before)
    return found
