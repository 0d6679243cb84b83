"""Torque saturation: the drive's torque is limited."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from plant.effects.effect import POSITIVE, Effect, Expression, Motion, Regressors, Stage, parameter


@dataclass(frozen=True, kw_only=True)
class TorqueSaturation(Effect):
    """A current or duty limit below the command of the log. Like the dead zone it needs no smoothing."""

    name = "torque_saturation"
    title = "torque saturation"
    stage = Stage.ACTUATOR
    equation = r"\tau \leftarrow \mathrm{clip}(\tau, -\tau_{max}, \tau_{max})"
    signature = "residual torque against torque, only above a level"
    confused_with = ("rate_limit", "back_emf", "load_dependent_friction")

    limit: float = parameter("{torque}", "largest torque", lower=POSITIVE)

    def command(self, torque: Expression, state: Expression, velocity: Expression) -> Expression:
        """The clipped torque."""
        return ca.fmax(ca.fmin(torque, self.limit), -self.limit)

    def command_for(self, torque: Expression, velocity: Expression) -> Expression:
        """At most the limit: more is not possible."""
        return ca.fmax(ca.fmin(torque, self.limit), -self.limit)

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """Torque removed by a limit, for limits from 0.3 to 0.97 of the largest command."""
        largest = float(np.max(np.abs(motion.torque), initial=0.0))
        shares = (0.3, 0.5, 0.7, 0.8, 0.9, 0.97)
        for limit in (share * largest for share in shares if largest > 0.0):
            clipped = motion.arriving(np.clip(motion.torque, -limit, limit))
            yield Regressors(
                columns=(clipped - motion.arriving(motion.torque))[:, None],
                positive=(True,),
                start=lambda c, limit=limit: cls(limit=limit),  # type: ignore[misc]
                searched=len(shares),
            )
