"""An eddy-current brake: an effect of one's own, imported by notebook 05 and read by `--effects eddy_brake.py`."""

from dataclasses import dataclass

import numpy as np

from plant.effects.effect import Effect, Regressors, Stage, parameter, within


@dataclass(frozen=True, kw_only=True)
class EddyBrake(Effect):
    """Drag of a conducting disc between magnets (Smythe 1942): most at the critical speed."""

    name = "eddy_brake"
    title = "eddy-current brake"
    stage = Stage.LOAD
    equation = r"\tau_e = -2 M \frac{\dot x / v_c}{1 + (\dot x / v_c)^2}"
    signature = "drag over velocity with a peak"
    confused_with = ("quadratic_drag", "stribeck_friction")

    torque: float = parameter("{torque}", "greatest torque M", lower=0.0)
    critical: float = parameter("{angle}/s", "critical speed v_c", lower=1e-3)

    def load_torque(self, at, state):
        share = at.velocity / self.critical
        return -2.0 * self.torque * share / (1.0 + share**2)

    @classmethod
    def regressors(cls, motion):
        fastest = float(np.quantile(np.abs(motion.velocity), 0.99))
        for speed in fastest * np.array([0.1, 0.2, 0.4, 0.8]):
            share = motion.velocity / speed
            yield Regressors(
                columns=-2.0 * (share / (1.0 + share**2))[:, None],
                positive=(True,),
                start=lambda c, speed=speed: cls(torque=within(c[0], cls, "torque"), critical=speed),
                searched=4,
            )
