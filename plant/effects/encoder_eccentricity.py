"""Encoder eccentricity: the disc's centre is not the axis."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from plant.effects.effect import Effect, Expression, Motion, Stage, Trace, parameter
from plant.effects.order_lines import as_wave, lines_over_angle, neighbouring, waves


@dataclass(frozen=True, kw_only=True)
class EncoderEccentricity(Effect):
    """A reading that runs ahead and behind with the angle; order 1 for a disc, others for its spokes or a screw."""

    name = "encoder_eccentricity"
    title = "encoder eccentricity"
    stage = Stage.SENSOR
    equation = r"y = x + a \sin(n x + \varphi)"
    trace = "order lines in the position error that no torque explains"
    confused_with = ("cogging", "gravity_offset")
    rugged = True
    of_lines = True

    amplitude: float = parameter("{angle}", "amplitude a", lower=0.0)
    order: float = parameter("rad/{angle}", "periods per turn n", lower=0.0)
    phase: float = parameter("rad", "phase at angle zero")

    def reading(self, angle: Expression, state: Expression) -> Expression:
        """The angle and its error."""
        return angle + self.amplitude * ca.sin(self.order * angle + self.phase)

    @classmethod
    def traces(cls, motion: Motion) -> Iterator[Trace]:
        """Sine and cosine at the first two orders, and at those that would improve the fit most.

        A part of a wave that is no longer than a radian cannot be told from a scale that is a little off.
        """
        found, searched = lines_over_angle(motion, motion.reading_score)
        first = [(order, 2) for order in (1.0, 2.0) if order * float(np.ptp(motion.angle)) > 1.0]
        for order, among in [*first, *((order, searched) for order in found)]:
            yield Trace(
                columns=waves(motion.angle, order),
                start=lambda c, order=order: cls(  # type: ignore[misc]
                    amplitude=as_wave(c)[0], order=order, phase=as_wave(c)[1]
                ),
                searched=among,
                acts_on="reading",
            )

    def neighbours(self, motion: Motion) -> Iterator[Trace]:
        """Sine and cosine at orders beside its own."""
        for rate in neighbouring(motion.angle, self.order):
            yield Trace(columns=waves(motion.angle, rate), start=lambda c: self, acts_on="reading")

    @classmethod
    def typical(cls, motion: Motion) -> Effect | None:
        """A disc off its centre: one period a turn."""
        amplitude, phase = as_wave(motion.visible(waves(motion.angle, 1.0), "reading"))
        return cls(amplitude=amplitude, order=1.0, phase=phase)
