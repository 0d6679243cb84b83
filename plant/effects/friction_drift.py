"""Friction drift: friction that changes while the log runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from plant.effects.effect import Effect, Expression, Moment, Motion, Stage, Trace, parameter, within


@dataclass(frozen=True, kw_only=True)
class FrictionDrift(Effect):
    """Viscous friction that rises or falls with time, and dry friction that builds up: temperature, grease, wear."""

    name = "friction_drift"
    title = "friction drift"
    stage = Stage.LOAD
    equation = r"K \leftarrow K + \dot K t,\quad F_c \leftarrow F_c + \dot F_c t"
    trace = "an error that grows along the log"
    confused_with = ("payload_change",)

    viscous_rate: float = parameter("{torque}/{angle}", "viscous friction gained per second")
    coulomb_rate: float = parameter("{torque}/s", "dry friction gained per second", lower=0.0, default=0.0)

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """The viscous part."""
        return -self.viscous_rate * at.time * at.velocity

    def dry_friction(self, at: Moment) -> tuple[Expression, Expression]:
        """The dry part, the same in both directions."""
        level = self.coulomb_rate * ca.fmax(at.time, 0)
        return level, level

    @classmethod
    def traces(cls, motion: Motion) -> Iterator[Trace]:
        """Velocity and direction, growing with time."""
        yield Trace(
            columns=-np.column_stack((motion.time * motion.velocity, motion.time * motion.sign)),
            positive=(False, True),
            start=lambda c: cls(viscous_rate=float(c[0]), coulomb_rate=within(c[1], cls, "coulomb_rate")),
        )
