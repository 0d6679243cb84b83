"""Dry friction beside the plan: what it is on the way that is planned, and what its scale is found to be.

The program plans the net torque, that which moves the load, with a model that has no dry friction; friction is added
to it afterwards, at the velocity of the governed reference. A program that has friction in it prefers to stay stuck:
it pays for the jump of the torque that a reversal needs, and its horizon is too short to see what that is worth.

Too little only sticks for a while, too much jumps. So what is added is what is sure: the scale less its standard error.
"""

from __future__ import annotations

from typing import Any, Self

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mpc.filter import finite, kalman_of
from mpc.slots import Kalman, Learnt, Rubbing, Tuning
from plant.effects import Moment, State
from plant.effects.effect import parameters_of
from plant.servo import ServoModel

Array = NDArray[np.float64]

_KEPT = 200.0
"""Periods of the loop over which what was learnt is forgotten."""

_CLEAR = 3.0
"""Standard deviations of the sensor that a load must move within 1/w to be known to slide."""


class Frictionless(ServoModel):
    """A servo without its dry friction, its parameters being those of the whole."""

    @classmethod
    def of(cls, model: ServoModel) -> Self:
        """The same servo."""
        own = {spec.name: getattr(model, spec.name) for spec in parameters_of(ServoModel)}
        return cls(**own, effects=model.effects, axis=model.axis, torque_unit=model.torque_unit)

    def dry_friction(self, at: Moment) -> None:
        """None."""


def rigid_contacts(model: ServoModel) -> ServoModel:
    """The model in which a contact that gives before it slides is one that slides at once.

    Its spring is too stiff for a sample and too short for a plan; what it takes beyond its travel is the same.
    """
    for effect in model.effects:
        if effect.states == (State.RELAXED,) and effect.reduced():
            for simpler in effect.reduced():
                model = model.without_effect(effect.name).with_effect(simpler)
    return model


def friction_numbers(
    *,
    std: float,
    wave: float,
    noise: float,
    resolution: float,
    jitter: float,
    floor: float,
    greatest: float,
    memory: float,
    quiet: float,
    jerk: float,
) -> Array:
    """The numbers of friction, see `mpc.slots.Rubbing`.

    A reference stands that passes less than the sensor's noise within the time of the loop. While it does, an
    innovation within half a count is none, less three standard deviations of the noise that would show what is inside.

    Args:
        std: standard error of the friction in the model, as a share of it.
        wave: w, 2 pi times the bandwidth of the loop.
        noise: standard deviation of the sensor with its steps [rad].
        resolution, jitter: its step and its noise beside that [rad].
        floor: least flank torque, seen at the load [N m]; undamped teeth swing by as much as the torque jumps. Zero
            keeps no teeth together and bounds nothing.
        greatest: torque of the drives [N m].
        memory: of the estimator [samples].
        quiet: change of the torque from sample to sample that the teeth bear all the time [N m]; so much the change of
            what is fed forward may grow in a sample.
        jerk: a quarter of how fast the acceleration of a move may change [rad/s^3].
    """
    deaf = max(resolution / 2 - 3 * jitter, 0.0)
    fades = wave / (2 * np.pi * _KEPT)
    own = [wave * noise, std, fades, deaf, floor or np.inf, _CLEAR * noise, greatest, max(memory, 1.0)]
    return np.array([*own, quiet, jerk])


def _levels(model: ServoModel, angle: Any, velocity: Any, torque: Any) -> tuple[Any, Any]:
    moment = Moment(angle=angle, velocity=velocity, torque=torque, inertia=model.inertia)
    return model.dry_friction(moment) or (0.0, 0.0)


def rub(model: ServoModel) -> Any:
    """Friction on the way, as far as it is sure, as a `casadi.Function`.

    (angle now and next (2,), the same one sample before, torque on the load, what was learnt, parameters, numbers)
    -> torque against friction [N m]. It changes its sense over twice the speed below which a reference stands, and no
    faster than the teeth bear.
    """
    way, torque, before = ca.SX.sym("way", 2), ca.SX.sym("torque"), ca.SX.sym("before")
    learnt, rubbing = ca.SX.sym("learnt", len(Learnt)), ca.SX.sym("rubbing", len(Rubbing))
    p = ca.SX.sym("p", len(model.names) + 1)
    wanted = (way[1] - way[0]) / p[-1]
    goes_on = ca.logic_or(learnt[Learnt.SHORT], ca.fabs(wanted) < rubbing[Rubbing.STANDS])
    sense = ca.if_else(goes_on, learnt[Learnt.SENSE], ca.sign(wanted))
    speed = ca.fmax(sense * wanted, sense * learnt[Learnt.VELOCITY])
    forward, backward = _levels(model.bound(p[:-1]), way[0], sense * speed, torque)
    sure = ca.fmax(learnt[Learnt.SCALE] - ca.sqrt(ca.fmax(learnt[Learnt.VAR_SCALE], 0)), 0)
    against = sure * sense * ca.if_else(sense > 0, forward, backward)
    greatest, most = rubbing[Rubbing.GREATEST], rubbing[Rubbing.MOST_CHANGE]
    last = ca.fmax(ca.fmin(before, greatest), -greatest)
    against = ca.fmax(ca.fmin(against, last + most), last - most)
    return ca.Function("rub", [way, before, torque, learnt, p, rubbing], [against], {"cse": True})


def learn(model: ServoModel, motors: bool) -> Any:
    """One sample of learning, as a `casadi.Function`.

    (state of the estimator, what was learnt, [torque against friction that acted, torque on the load, governed angle
    now, next and at the horizon's end], parameters, numbers, tuning) -> what is learnt, disturbance.

    While the load slides the disturbance d is what acts besides the model, b, less the friction s F that was not
    compensated, f: d = b - s F + f, a measurement of b and s. It is believed after the time that the loop takes, in
    the direction that the reference has; at rest, where friction takes any value up to breakaway, nothing is learnt and
    everything kept. When the reference sets out or turns, friction is another one from one sample to the next: what d
    had of it is taken away, as far as the friction that there can have been lets b be what was learnt.
    """
    n = len(model.states)
    m, kalman = n + 1 + 2 * motors, kalman_of(n, motors)
    learnt, now, tuning = ca.SX.sym("learnt", len(Learnt)), ca.SX.sym("now", 5), ca.SX.sym("tuning", len(Tuning))
    p, rubbing = ca.SX.sym("p", len(model.names) + 1), ca.SX.sym("rubbing", len(Rubbing))
    dt, wave, bound, stands = p[-1], tuning[Tuning.WAVE], model.bound(p[:-1]), rubbing[Rubbing.STANDS]
    d, angle, velocity = kalman[Kalman.DISTURBANCE], kalman[Kalman.ANGLE], kalman[Kalman.VELOCITY]
    d_variance = kalman[2 + m + n * (n + 1) // 2 + n]
    doubt, most = rubbing[Rubbing.STD] ** 2, tuning[Tuning.GREATEST] ** 2

    known = ca.logic_and(learnt[Learnt.KNOWN], finite(learnt))
    first: tuple[Any, ...] = (0, 0, 1, most, 0, doubt, 0, 0, angle, 0, 0)
    kept = [ca.if_else(known, learnt[i], value) for i, value in enumerate(first)]
    _, b, s, P_bb, P_bs, P_ss, before, slid, followed, *_ = kept
    shown = wave * (angle - followed)  # the estimate's velocity believes in the torque, also where friction holds
    followed += dt * shown

    speed = (now[3] - now[2]) / dt
    short = before * (now[4] - angle) > rubbing[Rubbing.ARRIVED]
    wanted = ca.if_else(short, before, ca.if_else(ca.fabs(speed) < stands, 0, ca.sign(speed)))
    sense = ca.if_else(ca.fabs(shown) > _CLEAR * stands, ca.sign(shown), 0)
    slides = ca.logic_and(sense != 0, sense == before)
    slid = ca.if_else(slides, slid + dt, 0)
    forward, backward = _levels(bound, angle, shown, now[1])
    friction = ca.if_else(sense > 0, forward, -backward)

    # Learn.
    fades = rubbing[Rubbing.FADES] * dt
    Q_bb, Q_ss = ca.fmin(P_bb + fades * friction**2, most), ca.fmin(P_ss + fades * doubt, doubt)
    towards_b, towards_s = Q_bb - friction * P_bs, P_bs - friction * Q_ss
    expected = towards_b - friction * towards_s + d_variance * rubbing[Rubbing.MEMORY]
    miss = d - now[0] - (b - s * friction)
    believed = ca.logic_and(slid > 1 / wave, expected > 0)
    gain_b, gain_s = (ca.if_else(believed, towards / expected, 0) for towards in (towards_b, towards_s))
    P_bb, P_ss = (ca.if_else(believed, Q, P) for Q, P in ((Q_bb, P_bb), (Q_ss, P_ss)))
    P_bb, P_bs, P_ss = P_bb - gain_b * towards_b, P_bs - gain_b * towards_s, ca.fmax(P_ss - gain_s * towards_s, 0)
    b, s = b + gain_b * miss, ca.fmax(ca.fmin(s + gain_s * miss, 2), 0)

    # Forget what the disturbance had of a friction that is over.
    std = 2 * ca.sqrt(P_ss)
    rest_forward, rest_backward = _levels(bound, angle, 0.0, now[1])
    least = ca.if_else(sense == 0, -(s + std) * rest_backward, s * friction - std * ca.fabs(friction))
    greatest = ca.if_else(sense == 0, (s + std) * rest_forward, s * friction + std * ca.fabs(friction))
    turns = ca.logic_and(wanted != 0, wanted != before)
    fitting = ca.fmax(ca.fmin(b, d - now[0] + greatest), d - now[0] + least)
    b = ca.if_else(turns, fitting, b)
    memory = ca.vertcat(1, b, s, P_bb, P_bs, P_ss, wanted, slid, followed, velocity, short)
    inputs = [kalman, learnt, now, p, rubbing, tuning]
    return ca.Function("learn", inputs, [memory, ca.if_else(turns, fitting, d)], {"cse": True})


def known_by_now(
    learn: Any, late: int, kalman: Any, learnt: Any, rubs: Any, past: Any, plan: Any, ahead: Any, **numbers: Any
) -> dict[str, Any]:
    """What is known of friction by now, as expressions; see rubbed in step.c.

    A disturbance that had a part of a friction that is over loses it; as much goes from what the torques did against
    friction to what they did besides.
    """
    total, N = past[late + 1] + rubs[late + 1], plan.numel() - 1
    now = ca.vertcat(rubs[1], total, ahead[late], ahead[late + 1], ahead[N])
    known, d = learn(kalman, learnt, now, numbers["model"], numbers["rubbing"], numbers["tuning"])
    more = kalman[Kalman.DISTURBANCE] - d
    moved = {"past": past + more, "rubs": rubs - more, "plan": ca.vertcat(plan[0], plan[1:] + more)}
    return {"learnt": known, "d": d, "total": total} | moved
