"""The torque that the governed reference takes: what the programme need not pay for.

The price of a change of torque makes the loop as fast as its margins allow, and no faster. A reference that the model
can follow is no business of that loop: the torque that it takes is known, so only what changes beside it has a price.
With a right model the load then follows at any bandwidth; what is left to the loop is what nobody knows.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from mpc.friction import RUBBING
from plant.effects import Moment
from plant.servo import ServoModel

FED = 4
"""What is remembered from sample to sample: whether anything is, the torque that was fed, its last change, and the last
change of the reference's speed in a sample [rad]."""


def feed(model: ServoModel) -> Any:
    """What the reference takes during a sample, as a `casadi.Function`.

    (governed angle now and at the two samples to come (3,), what was fed the sample before (FED,), parameters, numbers
    of friction) -> what is fed (FED,): torque on the load, rigid, without memory and dry friction. Smooth motion is fed
    as it is. Where the acceleration jumps the change of the torque grows from sample to sample by what the teeth bear
    all the time, up to what they bear once; so the noise of a reference is not fed. Where nothing is remembered it is
    the torque without acceleration.
    """
    way, before, rubbing = ca.SX.sym("way", 3), ca.SX.sym("before", FED), ca.SX.sym("rubbing", RUBBING)
    p = ca.SX.sym("p", len(model.names) + 1)
    bound, dt = model.bound(p[:-1]), p[-1]
    known, torque, change, bent = ca.vertsplit(before)
    first, second = way[1] - way[0], way[2] - way[1]
    at = Moment(angle=(way[0] + way[1]) / 2, velocity=first / dt, inertia=bound.inertia)
    still = [effect for effect in bound.effects if not effect.states]
    inertia = bound.inertia + sum(effect.added_inertia(at) for effect in still)
    passive = bound.gravity * ca.cos(at.angle) + bound.viscous_friction * at.velocity
    passive -= sum(effect.load_torque(at, 0.0) for effect in still)
    bend, most, quiet = second - first, rubbing[4], rubbing[8]
    more = inertia * (bend + bent) / (2 * dt**2) + passive - torque
    up, down = ca.fmin(ca.fmax(change, 0) + quiet, most), ca.fmax(ca.fmin(change, 0) - quiet, -most)
    more = ca.fmax(ca.fmin(more, up), down)
    fed = ca.if_else(known, ca.vertcat(1, torque + more, more, bend), ca.vertcat(1, passive, 0, 0))
    return ca.Function("feed", [way, before, p, rubbing], [fed], {"cse": True})
