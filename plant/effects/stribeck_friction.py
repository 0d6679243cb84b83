"""Stribeck friction: breakaway takes more torque than sliding."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from plant.effects.coulomb_friction import CoulombFriction
from plant.effects.effect import POSITIVE, Effect, Expression, Moment, Motion, Regressors, Stage, parameter, within


@dataclass(frozen=True, kw_only=True)
class StribeckFriction(Effect):
    """Dry friction that falls from a breakaway level to the Coulomb level as the contact gets moving.

    Source: Armstrong-Helouvry, Dupont, Canudas de Wit (1994), with exponent 2. With no excess it is Coulomb friction.
    """

    name = "stribeck_friction"
    title = "Stribeck friction"
    stage = Stage.LOAD
    equation = r"\tau_f \in -\left(F_c + \Delta F\,e^{-(\dot x/v_s)^2}\right)\mathrm{sgn}(\dot x)"
    signature = "jump and hump in the residual torque near zero velocity"
    confused_with = ("coulomb_friction", "presliding_hysteresis", "quadratic_drag")
    contains = ("coulomb_friction",)

    coulomb: float = parameter("{torque}", "sliding friction F_c", lower=0.0)
    excess: float = parameter("{torque}", "breakaway level above sliding, F_s - F_c", lower=0.0)
    velocity: float = parameter("{angle}/s", "Stribeck velocity v_s", lower=POSITIVE)

    def dry_friction(self, at: Moment) -> tuple[Expression, Expression]:
        """The Stribeck curve, the same in both directions."""
        level = self.coulomb + self.excess * ca.exp(-((at.velocity / self.velocity) ** 2))
        return level, level

    def reduced(self) -> tuple[Effect, ...]:
        """With no excess it is Coulomb friction."""
        return (CoulombFriction(torque=self.coulomb),)

    def vanishes(self, speed: float, sample_time: float) -> bool:
        """A hump much narrower than the velocity range is passed within a sample; it is an artefact of stiction."""
        return bool(self.velocity < 2e-3 * speed)

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """The direction, and the direction weighted by the Stribeck curve, for velocities over the range of the log."""
        fastest = float(np.quantile(np.abs(motion.velocity), 0.99))
        shares = (0.01, 0.03, 0.1, 0.2, 0.4)
        for scale in (share * fastest for share in shares if share * fastest > POSITIVE):
            hump = motion.sign * np.exp(-((motion.velocity / scale) ** 2))
            yield Regressors(
                columns=-np.column_stack((motion.sign, hump)),
                positive=(True, True),
                start=lambda c, scale=scale: cls(  # type: ignore[misc]
                    coulomb=within(c[0], cls, "coulomb"),
                    excess=within(c[1], cls, "excess", floor=0.1 * c[0]),
                    velocity=scale,
                ),
                searched=len(shares),
            )
