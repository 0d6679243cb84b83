"""Gravity offset: the centre of mass lies off the axis that the model assumes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from plant.effects.effect import Effect, Expression, Moment, Motion, Regressors, Stage, parameter


@dataclass(frozen=True, kw_only=True)
class GravityOffset(Effect):
    """The quadrature part of gravity; with eq. (4) the whole is -alpha cos x - beta sin x."""

    name = "gravity_offset"
    title = "gravity offset"
    stage = Stage.LOAD
    needs_angle = True
    equation = r"\tau_g = -\beta \sin x"
    signature = "sin x in residual torque"
    axes = ("rotary",)
    confused_with = ("torque_offset", "cable_stiffness", "encoder_eccentricity")

    beta: float = parameter("{torque}", "gravity torque in quadrature")

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """Counted like gravity in eq. (4)."""
        return -self.beta * ca.sin(at.angle)

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """The sine of the angle."""
        yield Regressors(columns=-np.sin(motion.angle)[:, None], start=lambda c: cls(beta=float(c[0])))
