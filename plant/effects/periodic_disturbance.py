"""Periodic disturbance: a torque that repeats in time, whatever the load does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from plant.effects.effect import Effect, Expression, Moment, Motion, Stage, Trace, parameter, within
from plant.effects.order_lines import strongest_lines


@dataclass(frozen=True, kw_only=True)
class PeriodicDisturbance(Effect):
    """A sine over time: a fan, the mains, a neighbouring machine."""

    name = "periodic_disturbance"
    title = "periodic disturbance"
    stage = Stage.LOAD
    equation = r"\tau_p = A \sin(2\pi f t + \varphi)"
    trace = "a line in time, not in angle"
    confused_with = ("cogging",)
    rugged = True

    amplitude: float = parameter("{torque}", "amplitude A", lower=0.0)
    frequency: float = parameter("Hz", "frequency f", lower=0.0)
    phase: float = parameter("rad", "phase at time zero of the log")

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """The sine."""
        return self.amplitude * ca.sin(2 * np.pi * self.frequency * at.time + self.phase)

    @classmethod
    def traces(cls, motion: Motion) -> Iterator[Trace]:
        """Sine and cosine at the frequencies that would improve the fit most."""
        rates, searched = strongest_lines(motion.time, motion.score, 2.0 * np.pi / (4.0 * motion.sample_time))
        middle = motion.time + 0.5 * motion.sample_time  # of the sample over which the torque acts
        for rate in rates:
            yield Trace(
                columns=np.column_stack((np.sin(rate * middle), np.cos(rate * middle))),
                start=lambda c, rate=rate: cls(  # type: ignore[misc]
                    amplitude=within(float(np.hypot(*c)), cls, "amplitude"),
                    frequency=rate / (2.0 * np.pi),
                    phase=float(np.arctan2(c[1], c[0])),
                ),
                searched=searched,
            )
