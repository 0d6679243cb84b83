"""Actuator lag: the current loop as a first-order low pass."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from plant.effects.effect import (
    POSITIVE,
    Array,
    Effect,
    Expression,
    Motion,
    Regressors,
    Stage,
    State,
    parameter,
    within,
)


@dataclass(frozen=True, kw_only=True)
class ActuatorLag(Effect):
    """The torque follows its command with a time constant; its state is the torque itself."""

    name = "actuator_lag"
    title = "actuator lag"
    stage = Stage.ACTUATOR
    equation = r"T_a \dot\tau_a = \tau - \tau_a"
    signature = "phase and amplitude fall at high frequency"
    confused_with = ("input_delay", "compliance", "sensor_lag")
    states = (State.TORQUE,)

    time_constant: float = parameter("s", "time constant", lower=POSITIVE, lag=True)

    def lateness(self) -> Expression:
        """The time constant."""
        return self.time_constant

    def advance(self, state: Expression, torque: Expression, h: Expression) -> Expression:
        """Exact solution over `h` for a constant command, so that short lags need no short steps."""
        return torque + (state - torque) * ca.exp(-h / self.time_constant)

    def settling_time(self, state: Expression, command: Expression) -> Expression:
        """Four time constants."""
        return 4 * self.time_constant

    def mean(self, state: Expression, torque: Expression, h: Expression) -> Expression:
        """Exact mean of the lagged torque over `h`."""
        settled = self.time_constant / ca.fmax(h, 1e-15) * (1 - ca.exp(-h / self.time_constant))
        return torque + (state - torque) * settled

    def command(self, torque: Expression, state: Expression, velocity: Expression) -> Expression:
        """The lagged torque."""
        return state

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """The lagged command less the command, for lags from half a sample to a few tens of samples."""
        samples = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
        for lag in (n * motion.sample_time for n in samples):
            yield Regressors(
                columns=(motion.arriving(lagged(motion, lag)) - motion.arriving(motion.torque))[:, None],
                positive=(True,),
                start=lambda c, lag=lag: cls(
                    time_constant=within(lag * min(c[0], 2.0), cls, "time_constant", floor=0.1 * lag)
                ),  # type: ignore[misc]
                searched=len(samples),
            )


def lagged(motion: Motion, lag: float) -> Array:
    """(T,) mean over each sample of the command after a first-order lag [N m]."""
    from scipy.signal import lfilter

    decay = np.exp(-motion.sample_time / lag)
    mean_decay = lag / motion.sample_time * (1.0 - decay)
    behind = np.empty_like(motion.torque)
    for run in np.unique(motion.run):
        torque = motion.torque[motion.run == run]
        state, _ = lfilter([0.0, 1.0 - decay], [1.0, -decay], torque, zi=[torque[0] * decay + torque[0] * (1 - decay)])
        behind[motion.run == run] = torque + (state - torque) * mean_decay
    return behind
