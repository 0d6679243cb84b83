"""Lag of the measured torque: a log of the motor's current is filtered."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from plant.effects.effect import Effect, Expression, Motion, Regressors, Stage, parameter, within


@dataclass(frozen=True, kw_only=True)
class TorqueMeasurementLag(Effect):
    """A first-order filter in the measurement of the torque that the log gives as the command.

    The acting torque is the torque of the log plus the time constant times its slope. It is linear from sample to
    sample, as a current in its loop; a command is held instead. `plant.discrete` takes the slope from the next sample,
    so only a log can be predicted: the machine does not have this lag, and a controller's model leaves it out.
    """

    name = "torque_measurement_lag"
    title = "lag of the measured torque"
    stage = Stage.ACTUATOR
    equation = r"\tau \leftarrow \tau + T_m \dot \tau"
    signature = "the load moves before the torque of the log says so"
    clocked = True
    measured = ("input_delay", "setpoint_rate_limit", "rate_limit", "actuator_lag", "torque_saturation", "back_emf")

    time_constant: float = parameter("s", "time constant", lower=0.0, lag=True)

    def lead(self) -> Expression:
        """The time constant."""
        return self.time_constant

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """The slope of the torque; none for a position servo, as its torque is not measured."""
        if np.any(motion.servo_gain > 0.0):
            return
        dt = motion.sample_time
        arriving = motion.arriving(motion.torque)
        rise = motion.by_run(lambda rows: np.diff(arriving[rows], append=arriving[rows][-1:])) / dt
        yield Regressors(
            columns=rise[:, None],
            positive=(True,),
            start=lambda c: cls(time_constant=within(c[0] - 0.5 * dt, cls, "time_constant", floor=0.1 * dt)),
        )
