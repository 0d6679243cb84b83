"""Friction drift: friction that changes while the log runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from plant.effects.coulomb_friction import CoulombFriction
from plant.effects.effect import Effect, Expression, Moment, Motion, Regressors, Stage, parameter, within

if TYPE_CHECKING:
    from plant.servo import ServoModel


@dataclass(frozen=True, kw_only=True)
class FrictionDrift(Effect):
    """Viscous friction that rises or falls with time, and dry friction that builds up: temperature, grease, wear."""

    name = "friction_drift"
    title = "friction drift"
    stage = Stage.LOAD
    equation = r"K \leftarrow K + \dot K t,\quad F_c \leftarrow F_c + \dot F_c t"
    signature = "an error that grows along the log"
    confused_with = ("payload_change",)
    clocked = True

    viscous_rate: float = parameter("{torque}/{angle}", "viscous friction gained per second")
    coulomb_rate: float = parameter("{torque}/s", "dry friction gained per second", lower=0.0, default=0.0)

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """The viscous part."""
        return -self.viscous_rate * at.time * at.velocity

    def dry_friction(self, at: Moment) -> tuple[Expression, Expression]:
        """The dry part, the same in both directions."""
        level = self.coulomb_rate * ca.fmax(at.time, 0)
        return level, level

    def without_clock(self, rest: ServoModel, end: float | None) -> ServoModel:
        """The friction reached at the end of the log.

        If the end is not known, the friction at time zero remains, the only one that the model gives without a clock. A
        controller tolerates a friction level that is too low; with one that is too high it overcompensates and
        oscillates.
        """
        if end is None:
            return rest
        kept = rest.effect("coulomb_friction")
        dry = max(self.coulomb_rate * end, 0.0) + (kept.torque if isinstance(kept, CoulombFriction) else 0.0)
        viscous = max(rest.viscous_friction + self.viscous_rate * end, 0.0)
        rest = replace(rest, viscous_friction=viscous)
        return rest.with_effect(CoulombFriction(torque=dry)) if dry > 0.0 else rest

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """Velocity and direction times the time."""
        yield Regressors(
            columns=-np.column_stack((motion.time * motion.velocity, motion.time * motion.sign)),
            positive=(False, True),
            start=lambda c: cls(viscous_rate=float(c[0]), coulomb_rate=within(c[1], cls, "coulomb_rate")),
        )
