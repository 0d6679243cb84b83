"""Non-parametric lag: a low pass delays a part of the torque, for whatever reason, as in `nonparametric_curve`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from plant.effects.actuator_lag import ActuatorLag, lagged
from plant.effects.effect import POSITIVE, Expression, Motion, Regressors, Stage, State, parameter
from plant.effects.nonparametric_curve import Nonparametric


@dataclass(frozen=True, kw_only=True)
class LaggedTorque(Nonparametric):
    """A part of the torque passes a low pass: all of it gives a lag, a small part of a long one gives creep."""

    name = "lagged_torque"
    title = "torque that lags"
    stage = Stage.ACTUATOR
    equation = r"\tau_u = c\,(z - \tau),\; T \dot z = \tau - z"
    signature = "phase falls at high frequency"
    variables = ("lagged torque",)
    states = (State.TORQUE,)

    time_constant: float = parameter("s", "time constant T", lower=POSITIVE, lag=True)
    part: float = parameter("-", "part c of the torque that lags")

    advance, mean, settling_time = ActuatorLag.advance, ActuatorLag.mean, ActuatorLag.settling_time

    def lateness(self) -> Expression:
        """Mean delay of the torque by the part that lags."""
        return self.part * self.time_constant

    def command(self, torque: Expression, state: Expression, velocity: Expression) -> Expression:
        """The lagged part plus the rest."""
        return torque + self.part * (state - torque)

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """The lagged torque less the torque, for lags from a part of a sample to some tens of samples."""
        samples = (0.3, 1.0, 3.0, 10.0, 30.0)
        for lag in (n * motion.sample_time for n in samples):
            yield Regressors(
                columns=(motion.arriving(lagged(motion, lag)) - motion.arriving(motion.torque))[:, None],
                start=lambda c, lag=lag: cls(time_constant=lag, part=float(c[0])),  # type: ignore[misc]
                searched=len(samples),
            )
