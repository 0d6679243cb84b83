"""Set-point rate limit: a position servo moves its internal set-point (goal) with a limited speed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from plant.effects.effect import POSITIVE, Array, Motion, Regressors, Stage, State, parameter
from plant.effects.ramp import Ramp


@dataclass(frozen=True, kw_only=True)
class SetpointRateLimit(Ramp):
    """Speed limit in the firmware of a position servo, before its law; the state is the internal set-point.

    A limit in angle per second is the same at every servo gain; a limit of the command is not. If the log gives the
    torque (servo gain zero) there is no set-point, and the command passes unchanged.
    """

    name = "setpoint_rate_limit"
    title = "set-point rate limit"
    stage = Stage.ACTUATOR
    equation = r"|\dot g| \le r,\quad \tau = k_p\,(g - x)"
    signature = "residual torque after fast changes of the set-point, equally long at every servo gain"
    confused_with = ("input_delay", "actuator_lag", "rate_limit", "torque_saturation")
    states = (State.SETPOINT,)

    rate: float = parameter("{angle}/s", "largest speed r of the internal set-point", lower=POSITIVE)

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """The limited set-point through the drive's law less the set-point; none without a set-point."""
        gain, command = motion.servo_gain, motion.command
        if np.any(gain > 0.0):
            setpoint = motion.by_run(lambda rows: setpoints(command[rows], gain[rows]))
            yield from cls.ramps(motion, setpoint, lambda limited: np.where(gain > 0.0, gain * limited, command))


def setpoints(command: Array, servo_gain: Array) -> Array:
    """(T,) set-points [rad] of the commands (T,) of one run.

    Where the servo gain (T,) is zero it is the last set-point before, at the start the first one to come; zero if there
    is none.
    """
    given = np.flatnonzero(servo_gain > 0.0)
    if given.size == 0:
        return np.zeros_like(command)
    latest = np.maximum(np.searchsorted(given, np.arange(command.size), side="right") - 1, 0)
    return np.asarray((command[given] / servo_gain[given])[latest])


def first_setpoint(command: Array, servo_gain: Array) -> float:
    """The first of the set-points of `setpoints` [rad]."""
    first = int(np.argmax(servo_gain > 0.0))
    return float(command[first] / servo_gain[first]) if servo_gain[first] > 0.0 else 0.0
