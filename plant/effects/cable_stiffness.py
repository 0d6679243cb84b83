"""Cable stiffness: cables and hoses pull the load back to a rest angle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from plant.effects.effect import Covered, Effect, Expression, Moment, Motion, Regressors, Stage, parameter
from plant.effects.torque_offset import TorqueOffset


@dataclass(frozen=True, kw_only=True)
class CableStiffness(Effect):
    """A spring to a rest angle that grows stiffer as it bends: cables, hoses, seals, flexures."""

    name = "cable_stiffness"
    title = "cable stiffness"
    stage = Stage.LOAD
    needs_angle = True
    equation = r"\tau_c = -k_1 (x - x_0) - k_3 (x - x_0)^3"
    signature = "residual torque over angle, aperiodic"
    confused_with = ("gravity_offset", "torque_offset", "asymmetric_friction")
    contains = ("torque_offset",)

    stiffness: float = parameter("{torque}/{angle}", "stiffness k_1 at the rest angle")
    cubic: float = parameter("{torque}/{angle}^3", "cubic stiffness k_3", default=0.0, lower=0.0)
    rest_angle: float = parameter("{angle}", "rest angle x_0", default=0.0)

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """Torque towards the rest angle."""
        deflection = at.angle - self.rest_angle
        return -self.stiffness * deflection - self.cubic * deflection**3

    def plausible(self, log: Covered) -> bool:
        """Stiffness not negative, and rest angle within one travel of the log: a distant rest angle is an offset."""
        return bool(self.stiffness >= 0.0 and log.low - log.travel <= self.rest_angle <= log.high + log.travel)

    def reduced(self) -> tuple[Effect, ...]:
        """A soft cable with a distant rest angle is a torque offset."""
        return (TorqueOffset(torque=self.stiffness * self.rest_angle + self.cubic * self.rest_angle**3),)

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """A linear and a cubic term about the middle of the travel."""
        middle = 0.5 * float(motion.angle.min() + motion.angle.max())
        deflection = motion.angle - middle

        def start(c: np.ndarray) -> Effect:
            reach = 0.5 * float(np.ptp(deflection)) or 1.0
            if c[1] * reach > 1e-3 * abs(c[0]):
                shift = float(np.clip(c[0] / c[1], -reach, reach))
            else:
                shift = float(np.clip(np.cbrt(c[0] / c[2]), -reach, reach)) if c[2] > 0.0 else 0.0
            return cls(stiffness=float(c[1]), cubic=float(c[2]), rest_angle=middle + shift)

        columns = np.column_stack((np.ones_like(deflection), -deflection, -(deflection**3)))
        yield Regressors(columns=columns, positive=(False, True, True), start=start)
