"""Backlash between motor and load."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from plant.effects.compliance import Compliance
from plant.effects.effect import (
    POSITIVE,
    Array,
    Effect,
    Expression,
    Motion,
    Regressors,
    Stage,
    State,
    fastest_swing,
    parameter,
    within,
)
from plant.recursion_cache import recursion

_STIFF = 400.0  # frequency on a flank that a log with 5 ms samples cannot distinguish from a rigid one [rad/s]
_DAMPING = 0.5  # damping ratio of a flank that counts as rigid
_STEPS = 4.0  # integration steps per radian of that oscillation
_SHARES = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)  # initial motor shares
_WIDTHS = (0.7, 1.0, 1.4)  # factors on the backlash found by a first descent, tried with each fraction

# Softer flanks: frequency relative to that of a rigid one, and damping ratio (never that of a rigid one). `_NEXT` has
# factors on both, relative to the flank before.
_SOFTER = ((1.0, 0.2), (1.0, 0.1), (0.7, 0.4), (0.5, 0.2), (0.5, 0.4), (0.35, 0.4), (0.35, 0.2))
_NEXT = ((0.5, 1.0), (0.7, 1.0), (0.85, 1.0), (1.2, 1.0), (1.5, 1.0), (1.0, 0.5), (1.0, 0.75), (1.0, 1.3), (1.0, 2.0))


@dataclass(frozen=True, kw_only=True)
class Backlash(Effect):
    """A motor with its own inertia that loses contact with the load, crosses the backlash and meets the other flank.

    A flank only pushes. It is a spring with a damper (Nordin and Gutman 2002), on which both masses would oscillate at
    the flank frequency. At first that is so high that the log cannot distinguish the flank from a rigid one, and is not
    fitted. Then softer flanks and flanks with less damping are tried; if one of them fits clearly better, frequency and
    damping are fitted too. A light motor crosses a wide backlash as fast as a heavy motor a narrow one: a log of a few
    seconds determines backlash times share to some per cent, each alone to a quarter. The likelihood has many maxima.
    The standard errors of a fit are those at its maximum; those of a diagnosis come from the scatter over parts of the
    log.
    """

    name = "backlash"
    title = "backlash"
    stage = Stage.DRIVETRAIN
    equation = (
        r"\tau_l = \max(0, k\,(|\theta - x| - g/2) + d\,(\dot\theta - \dot x)\,s)\,s,\; s = \mathrm{sgn}(\theta - x)"
    )
    signature = "dwell and a knock at each reversal of the torque"
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
        """Whether the flank is not rigid: its damping differs from the default, as no fit ends exactly there."""
        return not (isinstance(self.flank_damping, float) and self.flank_damping == _DAMPING)

    def step_within(self, sample_time: float) -> float:
        """A quarter of a radian of the oscillation on a flank."""
        return 1.0 / (_STEPS * self.flank_frequency)

    def share(self) -> Expression:
        """The motor's share."""
        return self.motor_share

    def coupling(self, twist: Expression, rate: Expression, inertia: Expression) -> Expression:
        """Torque of the flank in contact, zero without contact."""
        stiffness = self.motor_share * (1.0 - self.motor_share) * inertia * self.flank_frequency**2
        damping = 2.0 * self.flank_damping / self.flank_frequency
        ahead, behind = twist - self.gap / 2, twist + self.gap / 2
        forward = ca.if_else(ahead > 0, ca.fmax(ahead + damping * rate, 0), 0)
        backward = ca.if_else(behind < 0, ca.fmin(behind + damping * rate, 0), 0)
        return stiffness * (forward + backward)

    def loaded(self, before: float, after: float) -> Backlash:
        """The motor and its flanks do not change; rigid flanks stay rigid."""
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
        """A light motor crosses a wide backlash in the same time as a heavy one a narrow one."""
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
        """The same backlash between softer flanks, or flanks with less damping."""
        return () if self.freed else tuple(self._between(slower, damping) for slower, damping in _SOFTER)

    def _between(self, faster: float, damping: float) -> Backlash:
        frequency = within(self.flank_frequency * faster, Backlash, "flank_frequency")
        return replace(self, flank_frequency=frequency, flank_damping=within(damping, Backlash, "flank_damping"))

    def reduced(self) -> tuple[Effect, ...]:
        """For soft flanks, their spring alone, without backlash."""
        return (self._spring,) if self.freed else ()

    @property
    def _spring(self) -> Compliance:
        return Compliance(
            frequency=self.flank_frequency,
            damping=within(self.flank_damping, Compliance, "damping"),
            motor_share=self.motor_share,
        )

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """Torque missing during loss of contact and impact after it, for backlashes and shares on a grid.

        The typical torque crosses the backlash in half a sample to 60: a fine encoder shows the former too.
        """
        shares, samples = (0.1, 0.3, 0.6), np.geomspace(0.5, 60.0, 12)
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
            yield Regressors(
                columns=crossing[:, [place]],
                positive=(True,),
                start=lambda c, own=own, width=width: cls(  # type: ignore[misc]
                    gap=width * float(np.clip(c[0], 0.3, 2.0)), motor_share=own, flank_frequency=stiff
                ),
                searched=len(grid),
            )


def _crossing(motion: Motion, torque: Array, rows: NDArray[np.intp], share: Array, gap: Array) -> Array:
    """(T, G) torque on the total inertia added by a backlash, computed from the given acceleration without feedback."""
    side = np.full(gap.size, 1.0 if torque[rows[0]] >= 0.0 else -1.0)
    still = np.zeros(gap.size)
    moved = np.column_stack((torque[rows], motion.acceleration[rows]))
    follow, machine = _loose_motor(gap.size), np.array([motion.inertia, motion.sample_time])
    return follow((side, side * gap / 2.0, still, still), moved, share, gap, machine)[1][0]


@recursion(carried=4)
def _loose_motor(count: int) -> Any:
    """The motor in each of several backlashes: (side in contact, lead over the load, relative speed, whether loose).

    In contact the motor moves with the load and the flank transmits torque - J_m a; when that changes sign, contact is
    lost. On impact both masses share their momentum.
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
