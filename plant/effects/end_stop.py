"""End stop: the load hits a stop at one position."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from plant.effects.effect import POSITIVE, Covered, Effect, Expression, Moment, Motion, Regressors, Stage, parameter


@dataclass(frozen=True, kw_only=True)
class EndStop(Effect):
    """A stiff spring beyond a limit: above it where the stiffness is positive, below it where it is negative."""

    name = "end_stop"
    title = "end stop"
    stage = Stage.LOAD
    needs_angle = True
    equation = r"\tau_e = -k\,\max(\mathrm{sgn}(k)(x - x_e), 0)"
    signature = "residual torque on one side of one position"
    confused_with = ("cable_stiffness",)
    longest_step = 1e-3

    angle: float = parameter("{angle}", "where it is touched x_e")
    stiffness: float = parameter("{torque}/{angle}", "stiffness k; negative for a stop at the lower end")

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """Torque out of the stop."""
        beyond = at.angle - self.angle
        upper = ca.if_else(self.stiffness > 0, ca.fmax(beyond, 0), ca.fmin(beyond, 0))
        return -ca.fabs(self.stiffness) * upper

    def plausible(self, log: Covered) -> bool:
        """Whether it stops the load: at its typical speed the load enters by less than half of its travel."""
        return bool(np.sqrt(log.inertia / max(abs(self.stiffness), 1e-300)) * log.speed < 0.5 * log.travel)

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """Depth of the load in a stop, for stops near both ends of the travel; a stiff stop allows little depth."""
        low, high = float(motion.angle.min()), float(motion.angle.max())
        softest = 1e-6 * float(np.sqrt(np.mean(motion.torque**2))) / max(high - low, POSITIVE)
        shares = (0.0001, 0.0003, 0.001, 0.004, 0.02, 0.05, 0.1, 0.2, 0.35)
        for share in shares:
            for side, place in ((1.0, high - share * (high - low)), (-1.0, low + share * (high - low))):
                yield Regressors(
                    columns=-side * np.maximum(side * (motion.angle - place), 0.0)[:, None],
                    positive=(True,),
                    start=lambda c, side=side, place=place: cls(  # type: ignore[misc]
                        angle=place, stiffness=side * max(float(c[0]), softest)
                    ),
                    searched=2 * len(shares),
                )
