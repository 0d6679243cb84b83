"""Compensation of dry friction: friction along the planned path, and adaptation of its scale.

The program plans the net torque that accelerates the load, with a model without dry friction. The friction torque is
added to it afterwards, at the velocity of the governed reference. A program that includes friction tends to stay stuck:
the jump of the torque at a reversal has a cost, and the horizon is too short to see its benefit.

Too little compensation makes the load stick for a while, too much makes it jump. So the compensation uses the scale
minus its standard error.
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
"""Forgetting time of the adaptation, in periods of the loop."""

_CLEAR = 3.0
"""Motion within 1/w from which the load counts as sliding, in standard deviations of the sensor."""


class Frictionless(ServoModel):
    """A servo without its dry friction; it has all parameters of the full model."""

    @classmethod
    def of(cls, model: ServoModel) -> Self:
        """The same servo without dry friction."""
        own = {spec.name: getattr(model, spec.name) for spec in parameters_of(ServoModel)}
        return cls(**own, effects=model.effects, axis=model.axis, torque_unit=model.torque_unit)

    def dry_friction(self, at: Moment) -> None:
        """None."""


def rigid_contacts(model: ServoModel) -> ServoModel:
    """The model with presliding (elastic) friction replaced by friction that slides at once.

    The presliding stiffness is too high for the sample time, and its travel is too short to matter for a plan; the
    sliding friction is the same.
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

    A reference counts as standing still if it moves by less than the noise of the sensor within 1/w. During standstill
    the innovation has a dead band: half a step of the encoder minus three standard deviations of its noise, because
    noise makes positions inside a step visible.

    Args:
        std: relative standard error of the friction in the model.
        wave: w, 2 pi times the bandwidth of the loop.
        noise: standard deviation of the sensor with its steps [rad].
        resolution, jitter: step of the sensor, and its noise besides the steps [rad].
        floor: minimum contact torque, at the load [N m]; a jump of the torque makes the undamped gear contact oscillate
            with the same amplitude. Zero: no contact to keep, no limit.
        greatest: torque of the drives [N m].
        memory: of the estimator [samples].
        quiet: permanent change of the torque from sample to sample that the contact tolerates [N m]; the change of the
            feedforward torque may grow by this per sample.
        jerk: a quarter of the greatest rate of the acceleration of a move [rad/s^3].
    """
    deaf = max(resolution / 2 - 3 * jitter, 0.0)
    fades = wave / (2 * np.pi * _KEPT)
    own = [wave * noise, std, fades, deaf, floor or np.inf, _CLEAR * noise, greatest, max(memory, 1.0)]
    return np.array([*own, quiet, jerk])


def _levels(model: ServoModel, angle: Any, velocity: Any, torque: Any) -> tuple[Any, Any]:
    moment = Moment(angle=angle, velocity=velocity, torque=torque, inertia=model.inertia)
    return model.dry_friction(moment) or (0.0, 0.0)


def rub(model: ServoModel) -> Any:
    """Friction compensation along the path, with the scale minus its standard error, as a `casadi.Function`.

    (governed angle now and next (2,), compensation one sample before, torque on the load, memory of the adaptation,
    parameters, numbers) -> torque against friction [N m]. A reversal takes place over the speed interval of standstill,
    `Rubbing.STILL` on each side, and changes by at most `Rubbing.MOST_CHANGE` per sample.
    """
    way, torque, before = ca.SX.sym("way", 2), ca.SX.sym("torque"), ca.SX.sym("before")
    learnt, rubbing = ca.SX.sym("learnt", len(Learnt)), ca.SX.sym("rubbing", len(Rubbing))
    p = ca.SX.sym("p", len(model.names) + 1)
    wanted = (way[1] - way[0]) / p[-1]
    goes_on = ca.logic_or(learnt[Learnt.SHORT], ca.fabs(wanted) < rubbing[Rubbing.STILL])
    direction = ca.if_else(goes_on, learnt[Learnt.DIRECTION], ca.sign(wanted))
    speed = ca.fmax(direction * wanted, direction * learnt[Learnt.VELOCITY])
    forward, backward = _levels(model.bound(p[:-1]), way[0], direction * speed, torque)
    certain_scale = ca.fmax(learnt[Learnt.SCALE] - ca.sqrt(ca.fmax(learnt[Learnt.VAR_SCALE], 0)), 0)
    against = certain_scale * direction * ca.if_else(direction > 0, forward, backward)
    greatest, most = rubbing[Rubbing.GREATEST], rubbing[Rubbing.MOST_CHANGE]
    last = ca.fmax(ca.fmin(before, greatest), -greatest)
    against = ca.fmax(ca.fmin(against, last + most), last - most)
    return ca.Function("rub", [way, before, torque, learnt, p, rubbing], [against], {"cse": True})


def learn(model: ServoModel, motors: bool) -> Any:
    """One sample of the adaptation of friction, as a `casadi.Function`.

    (state of the estimator, memory, [acting compensation torque, torque on the load, governed angle now, next and at
    the end of the horizon], parameters, numbers, tuning) -> memory, disturbance.

    While the load slides, the disturbance d is the unmodelled constant torque b minus the friction s F plus its
    compensation f: d = b - s F + f, a measurement of b and the scale s. It is used after the load has slid for 1/w in
    the direction of compensation. At rest, where friction may have any value up to breakaway, nothing is learnt or
    forgotten. When the reference starts or reverses, friction changes from one sample to the next: its part is removed
    from d, so that b keeps its learnt value within the range of the possible friction.
    """
    n = len(model.states)
    m, kalman = n + 1 + 2 * motors, kalman_of(n, motors)
    learnt, now, tuning = ca.SX.sym("learnt", len(Learnt)), ca.SX.sym("now", 5), ca.SX.sym("tuning", len(Tuning))
    p, rubbing = ca.SX.sym("p", len(model.names) + 1), ca.SX.sym("rubbing", len(Rubbing))
    dt, wave, bound, still = p[-1], tuning[Tuning.WAVE], model.bound(p[:-1]), rubbing[Rubbing.STILL]
    d, angle, velocity = kalman[Kalman.DISTURBANCE], kalman[Kalman.ANGLE], kalman[Kalman.VELOCITY]
    d_variance = kalman[2 + m + n * (n + 1) // 2 + n]
    prior_variance, most = rubbing[Rubbing.STD] ** 2, tuning[Tuning.GREATEST] ** 2

    known = ca.logic_and(learnt[Learnt.KNOWN], finite(learnt))
    first: tuple[Any, ...] = (0, 0, 1, most, 0, prior_variance, 0, 0, angle, 0, 0)
    kept = [ca.if_else(known, learnt[i], value) for i, value in enumerate(first)]
    _, b, s, P_bb, P_bs, P_ss, before, slid, followed, *_ = kept
    shown = wave * (angle - followed)  # the estimated velocity responds to the torque even if friction holds the load
    followed += dt * shown

    speed = (now[3] - now[2]) / dt
    short = before * (now[4] - angle) > rubbing[Rubbing.ARRIVED]
    wanted = ca.if_else(short, before, ca.if_else(ca.fabs(speed) < still, 0, ca.sign(speed)))
    direction = ca.if_else(ca.fabs(shown) > _CLEAR * still, ca.sign(shown), 0)
    slides = ca.logic_and(direction != 0, direction == before)
    slid = ca.if_else(slides, slid + dt, 0)
    forward, backward = _levels(bound, angle, shown, now[1])
    friction = ca.if_else(direction > 0, forward, -backward)

    # Learn.
    fades = rubbing[Rubbing.FADES] * dt
    Q_bb, Q_ss = ca.fmin(P_bb + fades * friction**2, most), ca.fmin(P_ss + fades * prior_variance, prior_variance)
    towards_b, towards_s = Q_bb - friction * P_bs, P_bs - friction * Q_ss
    expected = towards_b - friction * towards_s + d_variance * rubbing[Rubbing.MEMORY]
    miss = d - now[0] - (b - s * friction)
    believed = ca.logic_and(slid > 1 / wave, expected > 0)
    gain_b, gain_s = (ca.if_else(believed, towards / expected, 0) for towards in (towards_b, towards_s))
    P_bb, P_ss = (ca.if_else(believed, Q, P) for Q, P in ((Q_bb, P_bb), (Q_ss, P_ss)))
    P_bb, P_bs, P_ss = P_bb - gain_b * towards_b, P_bs - gain_b * towards_s, ca.fmax(P_ss - gain_s * towards_s, 0)
    b, s = b + gain_b * miss, ca.fmax(ca.fmin(s + gain_s * miss, 2), 0)

    # Remove from the disturbance the part of a friction that no longer acts.
    std = 2 * ca.sqrt(P_ss)
    rest_forward, rest_backward = _levels(bound, angle, 0.0, now[1])
    least = ca.if_else(direction == 0, -(s + std) * rest_backward, s * friction - std * ca.fabs(friction))
    greatest = ca.if_else(direction == 0, (s + std) * rest_forward, s * friction + std * ca.fabs(friction))
    turns = ca.logic_and(wanted != 0, wanted != before)
    fitting = ca.fmax(ca.fmin(b, d - now[0] + greatest), d - now[0] + least)
    b = ca.if_else(turns, fitting, b)
    memory = ca.vertcat(1, b, s, P_bb, P_bs, P_ss, wanted, slid, followed, velocity, short)
    inputs = [kalman, learnt, now, p, rubbing, tuning]
    return ca.Function("learn", inputs, [memory, ca.if_else(turns, fitting, d)], {"cse": True})


def known_by_now(
    learn: Any, late: int, kalman: Any, learnt: Any, rubs: Any, past: Any, plan: Any, ahead: Any, **numbers: Any
) -> dict[str, Any]:
    """Adaptation of friction and its effect on the past torques, as expressions; see rubbed in step.c.

    If a part of friction is removed from the disturbance, the same amount moves from the past compensation torques to
    the past net torques.
    """
    total, N = past[late + 1] + rubs[late + 1], plan.numel() - 1
    now = ca.vertcat(rubs[1], total, ahead[late], ahead[late + 1], ahead[N])
    known, d = learn(kalman, learnt, now, numbers["model"], numbers["rubbing"], numbers["tuning"])
    more = kalman[Kalman.DISTURBANCE] - d
    moved = {"past": past + more, "rubs": rubs - more, "plan": ca.vertcat(plan[0], plan[1:] + more)}
    return {"learnt": known, "d": d, "total": total} | moved
