"""Quadratic drag: a resistance that grows with the square of speed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from plant.effects.effect import Effect, Expression, Moment, Motion, Regressors, Stage, parameter, within


@dataclass(frozen=True, kw_only=True)
class QuadraticDrag(Effect):
    """Air or churning resistance."""

    name = "quadratic_drag"
    title = "quadratic drag"
    stage = Stage.LOAD
    equation = r"\tau_d = -c\,\dot x\,|\dot x|"
    signature = "curved residual torque over velocity"
    confused_with = ("stribeck_friction", "coulomb_friction")

    drag: float = parameter("{torque} s^2/{angle}^2", "drag coefficient c", lower=0.0)

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """Against the motion."""
        return -self.drag * at.velocity * ca.fabs(at.velocity)

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """The signed square of the velocity."""
        yield Regressors(
            columns=-(motion.velocity * np.abs(motion.velocity))[:, None],
            positive=(True,),
            start=lambda c: cls(drag=within(c[0], cls, "drag")),
        )
