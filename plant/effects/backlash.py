"""Backlash: free play between motor and load."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from plant.built_once import recursion
from plant.effects.compliance import Compliance
from plant.effects.effect import (
    POSITIVE,
    Array,
    Effect,
    Expression,
    Motion,
    Stage,
    State,
    Trace,
    fastest_swing,
    parameter,
    within,
)

_STIFF = 400.0  # swing on the spring of a flank that a log of 5 ms cannot tell from a hard one [rad/s]
_DAMPING = 0.5  # of that swing on a flank that counts as hard
_STEPS = 4.0  # integration steps in a radian of that swing
_SHARES = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)  # of the inertia, to start from
_WIDTHS = (0.7, 1.0, 1.4)  # by which the gap is wider than what a first descent ended at, tried with each share

# Other flanks, by the frequency over a hard one's and the damping, which is never that of a hard one; and from there on
# by both over those of the flank before.
_SOFTER = ((1.0, 0.2), (1.0, 0.1), (0.7, 0.4), (0.5, 0.2), (0.5, 0.4), (0.35, 0.4), (0.35, 0.2))
_NEXT = ((0.5, 1.0), (0.7, 1.0), (0.85, 1.0), (1.2, 1.0), (1.5, 1.0), (1.0, 0.5), (1.0, 0.75), (1.0, 1.3), (1.0, 2.0))


@dataclass(frozen=True, kw_only=True)
class Backlash(Effect):
    """A motor with inertia of its own that loses contact with the load, crosses the backlash and meets the other flank.

    A flank only pushes. It is a spring with a damper (Nordin and Gutman 2002), on which both masses would swing at the
    flank frequency. At first that is so high that the log cannot tell the flank from a hard one, and is not fitted.
    Then flanks are tried that are softer, or damp a knock less; where one of them fits clearly better, frequency and
    damping are fitted too.
    A light motor crosses a wide gap as fast as a heavy motor a narrow one: a log of a few seconds determines gap times
    share to some per cent, each alone to a quarter. The likelihood has many maxima. The standard errors of a fit are
    those at its maximum; those of a diagnosis come from the scatter over parts of the log.
    """

    name = "backlash"
    title = "backlash"
    stage = Stage.DRIVETRAIN
    equation = (
        r"\tau_l = \max(0, k\,(|\theta - x| - g/2) + d\,(\dot\theta - \dot x)\,s)\,s,\; s = \mathrm{sgn}(\theta - x)"
    )
    trace = "dwell and a knock at each reversal of the torque"
    confused_with = ("dead_zone", "compliance", "presliding_hysteresis")
    multimodal = True
    chaotic = True
    states = (State.ANGLE, State.VELOCITY)
    flexible = True

    gap: float = parameter("{angle}", "angle from flank to flank", lower=0.0)
    motor_share: float = parameter("-", "share of the inertia on the motor's side", lower=0.02, upper=0.98)
    flank_frequency: float = parameter(
        "rad/s", "natural frequency of both masses in contact", lower=POSITIVE, swing=True, fitted=False, default=_STIFF
    )
    flank_damping: float = parameter(
        "-", "damping ratio in contact", lower=0.0, upper=10.0, fitted=False, default=_DAMPING
    )

    @property
    def freed(self) -> bool:
        """Of a flank that is not hard, which no fit ends at by itself: it is recognised by its damping."""
        return not (isinstance(self.flank_damping, float) and self.flank_damping == _DAMPING)

    def step_within(self, sample_time: float) -> float:
        """A quarter of a radian of the swing on a flank."""
        return 1.0 / (_STEPS * self.flank_frequency)

    def share(self) -> Expression:
        """The motor's share."""
        return self.motor_share

    def coupling(self, twist: Expression, rate: Expression, inertia: Expression) -> Expression:
        """The push of the flank in touch, if any."""
        stiffness = self.motor_share * (1.0 - self.motor_share) * inertia * self.flank_frequency**2
        damping = 2.0 * self.flank_damping / self.flank_frequency
        ahead, behind = twist - self.gap / 2, twist + self.gap / 2
        forward = ca.if_else(ahead > 0, ca.fmax(ahead + damping * rate, 0), 0)
        backward = ca.if_else(behind < 0, ca.fmin(behind + damping * rate, 0), 0)
        return stiffness * (forward + backward)

    def loaded(self, before: float, after: float) -> Backlash:
        """The motor and its flanks stay what they are; hard ones are hard before and after."""
        if self.freed:
            spring = self._spring.loaded(before, after)
            return replace(
                self,
                motor_share=spring.motor_share,
                flank_frequency=spring.frequency,
                flank_damping=spring.damping,
            )
        return replace(self, motor_share=within(self.motor_share * before / after, Backlash, "motor_share"))

    def similar_shapes(self, stage: int) -> tuple[Effect, ...]:
        """A light motor crosses a wide gap in the time in which a heavy one crosses a narrow one."""
        width = self.gap * self.motor_share
        if stage == 0:
            both = product(_WIDTHS, _SHARES)
            return tuple(replace(self, gap=times * width / share, motor_share=share) for times, share in both)
        factors = ((0.8, 0.9, 1.1, 1.25), (0.93, 0.97, 1.03, 1.07))[stage - 1]
        shares = [within(self.motor_share * factor, Backlash, "motor_share") for factor in factors]
        along = [replace(self, gap=width / share, motor_share=share) for share in shares]
        wider = [replace(self, gap=self.gap * factor) for factor in factors]
        if not self.freed or stage < 2:
            return (*along, *wider)
        return (*along, *wider, *(self._between(faster, more * self.flank_damping) for faster, more in _NEXT))

    def freer(self) -> tuple[Effect, ...]:
        """The same gap between flanks that are softer, or damp a knock less."""
        return () if self.freed else tuple(self._between(slower, damping) for slower, damping in _SOFTER)

    def _between(self, faster: float, damping: float) -> Backlash:
        frequency = within(self.flank_frequency * faster, Backlash, "flank_frequency")
        return replace(self, flank_frequency=frequency, flank_damping=within(damping, Backlash, "flank_damping"))

    def reduced(self) -> tuple[Effect, ...]:
        """Between soft flanks, the spring of the flanks alone."""
        return (self._spring,) if self.freed else ()

    @property
    def _spring(self) -> Compliance:
        return Compliance(
            frequency=self.flank_frequency,
            damping=within(self.flank_damping, Compliance, "damping"),
            motor_share=self.motor_share,
        )

    @classmethod
    def traces(cls, motion: Motion) -> Iterator[Trace]:
        """The torque that is missing in the gap and the knock behind it, for gaps and shares on a grid."""
        shares, samples = (0.1, 0.3, 0.6), np.geomspace(3.0, 60.0, 9)
        stiff = float(f"{fastest_swing(motion.sample_time):.3g}")
        torque = motion.arriving(motion.torque)
        level = float(np.sqrt(np.mean(torque**2)))
        if level <= 0.0:
            return
        grid = [
            (s, 0.5 * level / (s * motion.inertia) * (n * motion.sample_time) ** 2) for s in shares for n in samples
        ]
        share, gap = (np.array(column) for column in zip(*grid, strict=True))
        crossing = motion.by_run(lambda rows: _crossing(motion, torque, rows, share, gap))
        for place, (own, width) in enumerate(grid):
            yield Trace(
                columns=crossing[:, [place]],
                positive=(True,),
                start=lambda c, own=own, width=width: cls(  # type: ignore[misc]
                    gap=width * float(np.clip(c[0], 0.3, 2.0)), motor_share=own, flank_frequency=stiff
                ),
                searched=len(grid),
            )


def _crossing(motion: Motion, torque: Array, rows: NDArray[np.intp], share: Array, gap: Array) -> Array:
    """(T, G) torque on the whole inertia that a gap adds, from the load's own acceleration: nothing is fed back."""
    side = np.full(gap.size, 1.0 if torque[rows[0]] >= 0.0 else -1.0)
    still = np.zeros(gap.size)
    moved = np.column_stack((torque[rows], motion.acceleration[rows]))
    follow, machine = _loose_motor(gap.size), np.array([motion.inertia, motion.sample_time])
    return follow((side, side * gap / 2.0, still, still), moved, share, gap, machine)[1][0]


@recursion(carried=4)
def _loose_motor(count: int) -> Any:
    """The motor in each of several gaps: (side in touch, lead before the load, its speed, whether loose).

    In touch the motor moves with the load and the flank carries torque - J_m a; when that changes sign the motor lets
    go. On landing both masses share their momentum.
    """
    side, lead, speed, loose, share, gap = (ca.SX.sym(name, count) for name in ("s", "x", "v", "l", "share", "gap"))
    moved, machine = ca.SX.sym("moved", 2), ca.SX.sym("machine", 2)
    (drive, acceleration), (J, dt) = ca.vertsplit(moved), ca.vertsplit(machine)
    flies = ca.logic_or(loose > 0, (drive - share * J * acceleration) * side < 0)
    pull = drive / (share * J) - acceleration
    ahead = ca.if_else(flies, lead + speed * dt + 0.5 * pull * dt**2, lead)
    fast = ca.if_else(flies, speed + pull * dt, 0)
    free = (J * acceleration - drive) * share / (1 - share) - drive
    lands = ca.logic_and(flies, ca.logic_and(ca.fabs(ahead) >= gap / 2, ahead * fast >= 0))
    added = ca.if_else(flies, free, 0) + ca.if_else(lands, J * share * fast / dt, 0)
    touched = ca.if_else(lands, ca.sign(ahead), side)
    after = [touched, ca.if_else(lands, touched * gap / 2, ahead), ca.if_else(lands, 0, fast)]
    after.append(ca.logic_and(flies, ca.logic_not(lands)))
    inputs = [side, lead, speed, loose, moved, share, gap, machine]
    return ca.Function("loose_motor", inputs, [*after, added])
