"""Hysteresis of any shape: a curve over the travel since the last reversal, as in `nonparametric_curve`.

It represents torques with memory (presliding, creep, drag) that depend on more than angle and velocity.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from plant.effects.effect import POSITIVE, Expression, Moment, Motion, Regressors, State, parameter
from plant.effects.nonparametric_curve import HEIGHTS, KNOTS, Curve
from plant.effects.presliding_hysteresis import remembered, slid


@dataclass(frozen=True, kw_only=True)
class Hysteresis(Curve):
    """A curve over a memory state between minus and plus one; Dahl's friction is a straight line over it."""

    name = "hysteresis"
    title = "hysteresis"
    equation = r"\tau_u = f(z),\; dz/dx = (1 - \mathrm{sgn}(\dot x)\,z)/\ell"
    signature = "loops at a reversal"
    variables = ("angle", "velocity")
    states = (State.RELAXED,)
    longest_step = 1e-3

    way: float = parameter("{angle}", "travel l after which the past is forgotten", lower=POSITIVE)

    def slide(self, state: Expression, travel: Expression) -> Expression:
        """The memory after a travel in one direction."""
        return slid(state, travel, self.way)

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """The curve over the memory."""
        return self.course(self.slide(state, at.travel), self.low, self.high, self.values[2 : 2 + KNOTS])

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """One column for each knot, for memory lengths from a part of a sample's travel to a quarter of the range."""
        memories = list(remembered(motion))
        for way, memory in memories:
            yield Regressors(
                columns=cls.hats(memory, -1.0, 1.0),
                prior=cls.prior,
                start=lambda c, way=way: cls(  # type: ignore[misc]
                    low=-1.0, high=1.0, way=way, **dict(zip(HEIGHTS, map(float, c), strict=True))
                ),
                searched=len(memories),
            )
