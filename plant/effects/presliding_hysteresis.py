"""Presliding hysteresis: a contact deforms like a spring before it slides."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from plant.effects.coulomb_friction import CoulombFriction
from plant.effects.effect import (
    POSITIVE,
    Array,
    Effect,
    Expression,
    Moment,
    Motion,
    Regressors,
    Stage,
    State,
    parameter,
    within,
)
from plant.recursion_cache import recursion

_TRAVELS = 8


@dataclass(frozen=True, kw_only=True)
class PreslidingHysteresis(Effect):
    """Dahl's friction: a force that follows the travel and tends to the Coulomb level; its state is that force.

    Source: Dahl (1968), with exponent 1. It is smooth, and exact over any travel in one direction.
    """

    name = "presliding_hysteresis"
    title = "presliding hysteresis"
    stage = Stage.LOAD
    equation = r"dF/dx = \sigma\,(1 - \mathrm{sgn}(\dot x)\,F/F_c),\quad \tau_f = -F"
    signature = "loops at a reversal, spring-like at small motion"
    confused_with = ("coulomb_friction", "stribeck_friction", "backlash")
    contains = ("coulomb_friction",)
    states = (State.RELAXED,)
    longest_step = 1e-3

    torque: float = parameter("{torque}", "friction torque F_c", lower=POSITIVE)
    stiffness: float = parameter("{torque}/{angle}", "stiffness at a reversal", lower=POSITIVE)

    def slide(self, state: Expression, travel: Expression) -> Expression:
        """The friction torque after a travel in one direction."""
        level = self.torque * ca.sign(travel)
        return level + (state - level) * ca.exp(-ca.fabs(travel) * self.stiffness / self.torque)

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """Against the motion that has built it up."""
        return -self.slide(state, at.travel)

    def reduced(self) -> tuple[Effect, ...]:
        """With a very stiff contact it is Coulomb friction."""
        return (CoulombFriction(torque=self.torque),)

    def vanishes(self, speed: float, sample_time: float) -> bool:
        """Whether the time to pass the sliding travel is below a tenth of a millisecond or above a second.

        Below, the contact is rigid; above, it is a spring that never slides. The times hold for a log of 200 samples a
        second; at other rates they are as many samples.
        """
        second = 200.0 * sample_time
        return not 1e-4 * second * speed <= self.torque / self.stiffness <= second * speed

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """The loop, for sliding travels from a part of a sample's travel to a quarter of the range."""
        loops = list(remembered(motion))
        least = 1e-6 * float(np.sqrt(np.mean(motion.torque**2)))
        for travel, loop in loops:
            yield Regressors(
                columns=-loop[:, None],
                positive=(True,),
                start=lambda c, travel=travel: cls(  # type: ignore[misc]
                    torque=within(c[0], cls, "torque", floor=least),
                    stiffness=within(c[0] / travel, cls, "stiffness", floor=least / travel),
                ),
                searched=len(loops),
            )


def remembered(motion: Motion) -> Iterator[tuple[float, Array]]:
    """Memory lengths, from a part of a sample's travel to a quarter of the range, and (T,) `slid` along a motion."""
    typical = float(np.quantile(np.abs(motion.velocity), 0.9)) * motion.sample_time
    reach = float(np.ptp(motion.angle))
    if typical > 0.0 and reach > 0.0:
        travels = np.geomspace(0.3 * typical, max(0.25 * reach, typical), _TRAVELS)
        memories = motion.by_run(lambda rows: _memories(motion.angle[rows], travels))
        yield from zip(travels.tolist(), memories.T, strict=True)


def slid(state: Expression, travel: Expression, way: Expression) -> Expression:
    """Dahl's friction over its level, between -1 and 1, after a travel in one direction, with memory length `way`."""
    direction = ca.sign(travel)
    return direction + (state - direction) * ca.exp(-ca.fabs(travel) / way)


def _memories(angle: Array, travels: Array) -> Array:
    """(T, S) `slid` along an angle (T,) for each memory length (S,), as the mean over each sample."""
    travelled = np.diff(angle, append=angle[-1])[:, None]
    return _contacts(travels.size)((np.zeros(travels.size),), travelled, travels)[1][0]


@recursion(carried=1)
def _contacts(count: int) -> Any:
    """Several contacts in parallel, and the mean of each over a sample."""
    force, travels, travelled = ca.SX.sym("force", count), ca.SX.sym("travels", count), ca.SX.sym("travelled")
    after = slid(force, travelled, travels)
    outputs = [after, 0.5 * (force + after)]
    return ca.Function("contacts", [force, travelled, travels], outputs)
