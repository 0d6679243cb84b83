"""Back-EMF: a drive that sets a voltage loses torque with speed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from plant.effects.effect import Effect, Expression, Motion, Regressors, Stage, parameter, within


@dataclass(frozen=True, kw_only=True)
class BackEmf(Effect):
    """Torque that falls with the speed of the motor, before the dead zone.

    If no nonlinear effect follows it, it equals viscous friction, and a log cannot distinguish the two.
    """

    name = "back_emf"
    title = "back-EMF"
    stage = Stage.ACTUATOR
    equation = r"\tau \leftarrow \tau - k_e \dot x"
    signature = "viscous, but not within the dead zone"
    confused_with = ("quadratic_drag", "torque_saturation")

    constant: float = parameter("{torque} s/{angle}", "torque lost per speed k_e", lower=0.0)

    def command(self, torque: Expression, state: Expression, velocity: Expression) -> Expression:
        """The torque less the part lost to the induced voltage."""
        return torque - self.constant * velocity

    def command_for(self, torque: Expression, velocity: Expression) -> Expression:
        """The torque plus the part that the induced voltage will take."""
        return torque + self.constant * velocity

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """Torque lost at the load, for constants up to one that takes half the torque at top speed.

        With a small constant the torque may never enter the dead zone, and the effect equals viscous friction. The
        starts are therefore far apart.
        """
        top = float(np.quantile(np.abs(motion.velocity), 0.99))
        level = float(np.sqrt(np.mean(motion.torque**2)))
        if top <= 0.0 or level <= 0.0:
            return
        for constant in (0.02 * level / top, 0.5 * level / top):
            lost = motion.arriving(motion.torque - constant * motion.velocity) - motion.arriving(motion.torque)
            yield Regressors(
                columns=lost[:, None] / constant,
                positive=(True,),
                start=lambda c, least=0.3 * constant: cls(  # type: ignore[misc]
                    constant=within(c[0], cls, "constant", floor=least)
                ),
                searched=2,
            )
