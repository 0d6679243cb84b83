"""Sensor lag: the measurement lags behind the angle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca

from plant.effects.effect import POSITIVE, Effect, Expression, Motion, Regressors, Stage, State, parameter, within


@dataclass(frozen=True, kw_only=True)
class SensorLag(Effect):
    """A first-order filter in the measurement; its state is the measurement."""

    name = "sensor_lag"
    title = "sensor lag"
    stage = Stage.SENSOR
    needs_angle = True
    equation = r"T_s \dot y = x - y"
    signature = "the measurement lags by a fixed time, whatever the torque"
    confused_with = ("input_delay", "actuator_lag")
    states = (State.ANGLE,)

    time_constant: float = parameter("s", "time constant", lower=POSITIVE, lag=True)

    def advance_sensor(
        self, state: Expression, before: Expression, middle: Expression, after: Expression, h: Expression
    ) -> Expression:
        """Exact for an angle on a parabola, as of a load under a constant torque."""
        gone = ca.fmax(h / self.time_constant, 1e-9)  # a switch may leave a step of length zero, where all is rounding
        speed, curvature = 4 * middle - 3 * before - after, 2 * (before - 2 * middle + after)  # times h and h^2
        trail = (1 - ca.exp(-gone)) / gone
        kept = (state - before) * ca.exp(-h / self.time_constant)
        return after + kept - speed * trail - 2 * curvature * (1 - trail) / gone

    def measurement(self, angle: Expression, state: Expression) -> Expression:
        """The filtered angle."""
        return state

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """The velocity of the load."""
        yield Regressors(
            columns=-motion.velocity[:, None],
            positive=(True,),
            start=lambda c: cls(time_constant=within(c[0], cls, "time_constant", floor=0.1 * motion.sample_time)),
            acts_on="measurement",
        )
