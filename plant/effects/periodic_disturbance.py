"""Periodic disturbance: a torque that repeats in time, independent of the motion."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from plant.effects.effect import Covered, Effect, Expression, Moment, Motion, Regressors, Stage, parameter
from plant.effects.spectral_lines import as_wave, closer, eight_periods, lines_over_time, waves


@dataclass(frozen=True, kw_only=True)
class PeriodicDisturbance(Effect):
    """A sine over time: a fan, the mains, a neighbouring machine.

    Without the log's clock its phase is unknown, and it is left out.
    """

    name = "periodic_disturbance"
    title = "periodic disturbance"
    stage = Stage.LOAD
    equation = r"\tau_p = A \sin(2\pi f t + \varphi)"
    signature = "a line in time, not in angle"
    confused_with = ("cogging",)
    multimodal = True
    periodic = True
    clocked = True

    amplitude: float = parameter("{torque}", "amplitude A", lower=0.0)
    frequency: float = parameter("Hz", "frequency f", lower=0.0)
    phase: float = parameter("rad", "phase at time zero of the log")

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """The sine."""
        return self.amplitude * ca.sin(2 * np.pi * self.frequency * at.time + self.phase)

    def plausible(self, log: Covered) -> bool:
        """Whether the log covers two periods; otherwise it is a torque drift."""
        return self.frequency * log.duration >= 2.0

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """Sine and cosine at the frequencies that would improve the fit most, unless the motion repeats with them."""
        rates, searched = lines_over_time(motion)
        return (cls._at(rate, motion, searched) for rate in rates)

    def closer(self, motion: Motion) -> Iterator[Regressors]:
        """Sine and cosine at neighbouring frequencies."""
        return (self._at(rate, motion) for rate in closer(motion.time, 2.0 * np.pi * self.frequency))

    @classmethod
    def _at(cls, rate: float, motion: Motion, searched: int = 1) -> Regressors:
        return Regressors(
            columns=waves(motion.time + 0.5 * motion.sample_time, rate),  # the middle of the sample over which it acts
            start=lambda c: cls(amplitude=as_wave(c)[0], frequency=rate / (2.0 * np.pi), phase=as_wave(c)[1]),
            searched=searched,
        )

    @classmethod
    def typical(cls, motion: Motion) -> Effect | None:
        """Eight periods over the log."""
        rate = eight_periods(motion.time)
        amplitude, phase = as_wave(motion.visible(waves(motion.time, rate)))
        return cls(amplitude=amplitude, frequency=rate / (2.0 * np.pi), phase=phase)
