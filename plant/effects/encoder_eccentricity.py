"""Encoder eccentricity: the disc's centre is not the axis."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from plant.effects.effect import TURN, Covered, Effect, Expression, Motion, Regressors, Stage, parameter
from plant.effects.spectral_lines import as_wave, closer, lines_over_angle, waves

_FIRST = (1.0, 2.0)  # orders of an eccentric disc, and of an elliptical one
_ONCE = 0.9  # order from which a line counts as one per turn, given the resolution of a short travel


@dataclass(frozen=True, kw_only=True)
class EncoderEccentricity(Effect):
    """A measurement error, a sine of the angle: order 1 for an eccentric disc, other orders for spokes or a screw."""

    name = "encoder_eccentricity"
    title = "encoder eccentricity"
    stage = Stage.SENSOR
    needs_angle = True
    equation = r"y = x + a \sin(n x + \varphi)"
    signature = "order lines in the position error that no torque explains"
    confused_with = ("cogging", "gravity_offset")
    multimodal = True
    periodic = True

    amplitude: float = parameter("{angle}", "amplitude a", lower=0.0)
    order: float = parameter("rad/{angle}", "periods per turn n", lower=0.0)
    phase: float = parameter("rad", "phase at angle zero")

    def measurement(self, angle: Expression, state: Expression) -> Expression:
        """The angle plus its error."""
        return angle + self.amplitude * ca.sin(self.order * angle + self.phase)

    def plausible(self, log: Covered) -> bool:
        """Whether it has at least one period per turn, or two periods in the log: a slower wave is a trend.

        A disc is not eccentric by half of its radius: the measured speed would deviate by half.
        """
        wave = self.order * log.turn >= _ONCE * TURN or self.order * log.travel >= 2.0 * TURN
        return wave and self.amplitude * self.order < 0.5

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """Sine and cosine at the first two orders of a turn, and at those that would improve the fit most.

        A section of a wave shorter than a radian cannot be distinguished from an error of scale.
        """
        found, searched = lines_over_angle(motion, "measurement")
        first = [(order, 2) for order in _FIRST if motion.turn and order * float(np.ptp(motion.angle)) > 1.0]
        return (cls._at(order, motion, among) for order, among in [*first, *((order, searched) for order in found)])

    def closer(self, motion: Motion) -> Iterator[Regressors]:
        """Sine and cosine at neighbouring orders; the first two orders are fixed."""
        orders = closer(motion.angle, self.order) if self.order not in _FIRST else ()
        return (self._at(order, motion) for order in orders)

    @classmethod
    def _at(cls, order: float, motion: Motion, searched: int = 1) -> Regressors:
        return Regressors(
            columns=waves(motion.angle, order),
            start=lambda c: cls(amplitude=as_wave(c)[0], order=order, phase=as_wave(c)[1]),
            searched=searched,
            acts_on="measurement",
        )

    @classmethod
    def typical(cls, motion: Motion) -> Effect | None:
        """An eccentric disc: one period per turn."""
        amplitude, phase = as_wave(motion.visible(waves(motion.angle, 1.0), "measurement"))
        return cls(amplitude=amplitude, order=1.0, phase=phase)
