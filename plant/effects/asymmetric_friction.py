"""Asymmetric friction: Coulomb and viscous parts that differ by direction."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from plant.effects.coulomb_friction import CoulombFriction
from plant.effects.effect import Effect, Expression, Moment, Motion, Regressors, Stage, parameter, within


@dataclass(frozen=True, kw_only=True)
class AsymmetricFriction(Effect):
    """Dry friction with a size for each direction, and a viscous part that differs between them."""

    name = "asymmetric_friction"
    title = "asymmetric friction"
    stage = Stage.LOAD
    equation = r"\tau_f \in -F_\pm\,\mathrm{sgn}(\dot x) - \Delta K\,|\dot x|"
    signature = "two branches over velocity"
    confused_with = ("torque_offset", "coulomb_friction", "stribeck_friction")
    contains = ("coulomb_friction",)

    forward: float = parameter("{torque}", "friction torque against forward motion", lower=0.0)
    backward: float = parameter("{torque}", "friction torque against backward motion", lower=0.0)
    viscous_difference: float = parameter(
        "{torque} s/{angle}", "viscous friction: forward more, backward less, by this", default=0.0
    )

    def dry_friction(self, at: Moment) -> tuple[Expression, Expression]:
        """A separate level for each direction."""
        return self.forward, self.backward

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """The part of the viscous friction that changes with direction."""
        return -self.viscous_difference * ca.fabs(at.velocity)

    def reduced(self) -> tuple[Effect, ...]:
        """With both directions alike it is Coulomb friction."""
        return (CoulombFriction(torque=0.5 * (self.forward + self.backward)),)

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """Each direction separately, and the speed."""
        forward, backward = np.clip(motion.sign, 0.0, None), np.clip(motion.sign, None, 0.0)
        yield Regressors(
            columns=-np.column_stack((forward, backward, np.abs(motion.velocity))),
            positive=(True, True, False),
            start=lambda c: cls(
                forward=within(c[0], cls, "forward"),
                backward=within(c[1], cls, "backward"),
                viscous_difference=float(c[2]),
            ),
        )
