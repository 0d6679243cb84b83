"""Rate limit: the command is followed with a limited slope."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from plant.effects.effect import Array, Effect, Expression, Motion, Stage, State, Trace, parameter


@dataclass(frozen=True, kw_only=True)
class RateLimit(Effect):
    """Slew limit of the torque or, of a position servo, of its internal goal; its state is the command that is played.

    On a position servo the command is gain times goal, and so is the rate.
    """

    name = "rate_limit"
    title = "rate limit"
    stage = Stage.ACTUATOR
    equation = r"|\dot\tau| \le r"
    trace = "missing torque after fast changes of the command, and only there"
    confused_with = ("actuator_lag", "torque_saturation", "input_delay")
    states = (State.COMMAND,)

    rate: float = parameter("{torque}/s", "largest slope r", lower=1e-9)

    def advance(self, state: Expression, torque: Expression, h: Expression) -> Expression:
        """A ramp towards the command."""
        reach = self.rate * h
        return state + ca.fmax(ca.fmin(torque - state, reach), -reach)

    def settling_time(self, state: Expression, command: Expression) -> Expression:
        """Until the ramp ends."""
        return ca.fabs(command - state) / self.rate

    def mean(self, state: Expression, torque: Expression, h: Expression) -> Expression:
        """Exact mean of the ramp and of what comes behind it."""
        reach = self.rate * h
        share = ca.fmin(ca.fabs(torque - state) / ca.fmax(reach, 1e-12), 1)  # of the time that is spent on the ramp
        return state + (self.advance(state, torque, h) - state) * (1 - share / 2)

    @classmethod
    def traces(cls, motion: Motion) -> Iterator[Trace]:
        """The limited command less the command, for rates that cross the range in 2 to 150 samples."""
        samples = np.array([2.0, 5.0, 12.0, 30.0, 75.0, 150.0])
        span = float(np.ptp(motion.command))
        if span <= 0.0:
            return
        rates = span / (samples * motion.sample_time)
        limited = motion.by_run(lambda rows: _limited(motion.command[rows], rates * motion.sample_time))
        for place, rate in enumerate(rates):
            lacking = motion.arriving(motion.torque + limited[:, place] - motion.command)
            yield Trace(
                columns=(lacking - motion.arriving(motion.torque))[:, None],
                positive=(True,),
                start=lambda c, rate=rate: cls(rate=float(rate)),  # type: ignore[misc]
                searched=samples.size,
            )


def _limited(command: Array, reach: Array) -> NDArray[np.float64]:
    """(T, R) mean over each sample of a command (T,) that is followed by at most `reach` (R,) a sample."""
    played, means = np.full(reach.size, command[0]), np.empty((command.size, reach.size))
    for k, wanted in enumerate(command):
        gap = wanted - played
        step = np.clip(gap, -reach, reach)
        share = np.minimum(np.abs(gap) / reach, 1.0)  # of the sample that is spent on the ramp
        means[k] = played + step * (1.0 - share / 2.0)
        played = played + step
    return means
