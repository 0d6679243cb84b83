"""Rate limit: the command is followed with a limited slope."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from plant.effects.effect import POSITIVE, Motion, Regressors, Stage, State, parameter
from plant.effects.ramp import Ramp


@dataclass(frozen=True, kw_only=True)
class RateLimit(Ramp):
    """Slew limit of the torque; its state is the command after the limit.

    The command of a position servo is gain times set-point. There a limit of the set-point, `setpoint_rate_limit`, is
    the same at one gain and valid at several, so `rate_limit` has no signature in the log of a position servo.
    """

    name = "rate_limit"
    title = "rate limit"
    stage = Stage.ACTUATOR
    equation = r"|\dot\tau| \le r"
    signature = "residual torque after fast changes of the command, and only there"
    confused_with = ("actuator_lag", "torque_saturation", "input_delay")
    states = (State.COMMAND,)

    rate: float = parameter("{torque}/s", "largest slope r", lower=POSITIVE)

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """The limited command less the command; none for a position servo."""
        if not np.any(motion.servo_gain > 0.0):
            yield from cls.ramps(motion, motion.command, lambda limited: limited)
