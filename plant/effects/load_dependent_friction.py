"""Load-dependent friction: friction of a gear that grows with the transmitted torque."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from plant.effects.effect import Covered, Effect, Expression, Moment, Motion, Regressors, Stage, parameter, within


@dataclass(frozen=True, kw_only=True)
class LoadDependentFriction(Effect):
    """Dry friction in proportion to the torque that arrives at the load: worm, screw and planetary gears."""

    name = "load_dependent_friction"
    title = "load-dependent friction"
    stage = Stage.DRIVETRAIN
    equation = r"\tau_f \in -\mu\,|\tau_l|\,\mathrm{sgn}(\dot x)"
    signature = "friction differs between loaded and unloaded motion"
    confused_with = ("coulomb_friction", "stribeck_friction", "dead_zone", "torque_saturation")

    coefficient: float = parameter("-", "friction per torque mu", lower=0.0, upper=1.0)

    def dry_friction(self, at: Moment) -> tuple[Expression, Expression]:
        """The same level in both directions."""
        level = self.coefficient * ca.fabs(at.torque)
        return level, level

    def plausible(self, log: Covered) -> bool:
        """A gear that loses more than half of the torque is self-locking: the load cannot drive it."""
        return self.coefficient <= 0.5

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """The magnitude of the torque, against the motion."""
        yield Regressors(
            columns=-(np.abs(motion.arriving(motion.torque)) * motion.sign)[:, None],
            positive=(True,),
            start=lambda c: cls(coefficient=within(c[0], cls, "coefficient")),
        )
