"""Coulomb friction: constant torque against the motion, with stiction at rest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from plant.effects.effect import Effect, Expression, Moment, Motion, Regressors, Stage, parameter, within


@dataclass(frozen=True, kw_only=True)
class CoulombFriction(Effect):
    """Friction of constant size against the motion; at rest it holds up to that size."""

    name = "coulomb_friction"
    title = "Coulomb friction"
    stage = Stage.LOAD
    equation = r"\tau_f \in -F_c\,\mathrm{sgn}(\dot x)"
    signature = "jump in residual torque at zero velocity"
    confused_with = ("stribeck_friction", "asymmetric_friction", "dead_zone", "presliding_hysteresis")

    torque: float = parameter("{torque}", "friction torque F_c", lower=0.0)

    def dry_friction(self, at: Moment) -> tuple[Expression, Expression]:
        """The same level in both directions."""
        return self.torque, self.torque

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """The direction of motion."""
        yield Regressors(
            columns=-motion.sign[:, None],
            positive=(True,),
            start=lambda c: cls(torque=within(c[0], cls, "torque")),
        )
