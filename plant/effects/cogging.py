"""Cogging: a torque that repeats with the angle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca

from plant.effects.effect import TURN, Covered, Effect, Expression, Moment, Motion, Regressors, Stage, parameter
from plant.effects.spectral_lines import as_wave, closer, eight_periods, lines_over_angle, waves


@dataclass(frozen=True, kw_only=True)
class Cogging(Effect):
    """A torque ripple over the angle: poles passing slots, teeth in mesh, a screw's turn."""

    name = "cogging"
    title = "cogging"
    stage = Stage.LOAD
    needs_angle = True
    equation = r"\tau_c = A \sin(n x + \varphi)"
    signature = "order lines over angle, constant in torque"
    confused_with = ("encoder_eccentricity", "gravity_offset")
    multimodal = True
    periodic = True

    amplitude: float = parameter("{torque}", "amplitude A", lower=0.0)
    order: float = parameter("rad/{angle}", "periods per turn n", lower=0.0)
    phase: float = parameter("rad", "phase at angle zero")

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """The torque ripple."""
        return self.amplitude * ca.sin(self.order * at.angle + self.phase)

    def plausible(self, log: Covered) -> bool:
        """Whether the log covers two periods: a slower wave is a trend, which many sums of other effects look like.

        A wave of one period per turn over the whole travel is gravity with its offset.
        """
        as_gravity = log.turn > 0.0 and abs(self.order - TURN / log.turn) * log.travel < 0.5 * TURN
        return self.order * log.travel >= 2.0 * TURN and not as_gravity

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """Sine and cosine at the orders that would improve the fit most."""
        orders, searched = lines_over_angle(motion)
        return (cls._at(order, motion, searched) for order in orders)

    def closer(self, motion: Motion) -> Iterator[Regressors]:
        """Sine and cosine at neighbouring orders."""
        return (self._at(order, motion) for order in closer(motion.angle, self.order))

    @classmethod
    def _at(cls, order: float, motion: Motion, searched: int = 1) -> Regressors:
        return Regressors(
            columns=waves(motion.angle, order),
            start=lambda c: cls(amplitude=as_wave(c)[0], order=order, phase=as_wave(c)[1]),
            searched=searched,
        )

    @classmethod
    def typical(cls, motion: Motion) -> Effect | None:
        """Eight periods over the travel."""
        order = eight_periods(motion.angle)
        amplitude, phase = as_wave(motion.visible(waves(motion.angle, order)))
        return cls(amplitude=amplitude, order=order, phase=phase)
