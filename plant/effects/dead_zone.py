"""Dead zone: small torque commands have no effect (paper, eq. 6)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from plant.effects.effect import Effect, Expression, Motion, Regressors, Stage, parameter, within


@dataclass(frozen=True, kw_only=True)
class DeadZone(Effect):
    """Torques below the half width gamma do nothing; larger ones arrive reduced by it."""

    name = "dead_zone"
    title = "dead zone"
    stage = Stage.ACTUATOR
    equation = r"h(\tau) = \tau - \mathrm{clip}(\tau, -\gamma, \gamma)"
    signature = "residual torque against torque, near zero"
    confused_with = ("coulomb_friction", "backlash")

    half_width: float = parameter("{torque}", "half width gamma", lower=0.0)

    def command(self, torque: Expression, state: Expression, velocity: Expression) -> Expression:
        """Eq. (6) for both signs of the torque, without smoothing; a fit can start from width zero."""
        return ca.fmax(torque - self.half_width, 0) + ca.fmin(torque + self.half_width, 0)

    def command_for(self, torque: Expression, velocity: Expression) -> Expression:
        """The torque plus the half width; none for no torque."""
        return torque + self.half_width * ca.sign(torque)

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """The clipped torque, for half widths up to half of the largest torque."""
        largest = float(np.max(np.abs(motion.torque), initial=0.0))
        shares = (0.01, 0.03, 0.1, 0.25, 0.5)
        for width in (share * largest for share in shares):
            yield Regressors(
                columns=-np.clip(motion.torque, -width, width)[:, None],
                positive=(True,),
                start=lambda c, width=width: cls(half_width=within(width * min(c[0], 2.0), cls, "half_width")),  # type: ignore[misc]
                searched=len(shares),
            )
