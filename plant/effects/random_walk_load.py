"""A random-walk load torque: nothing to be named, but noise that a model must not be extended for.

It is not in the catalogue. Beside it an observer has a third state, and a simulation nothing at all.
"""

from __future__ import annotations

from dataclasses import dataclass

from plant.effects.effect import Effect, Expression, Moment, Stage, State


@dataclass(frozen=True, kw_only=True)
class RandomWalkLoad(Effect):
    """Its state is the acceleration that it gives the load [rad/s^2]."""

    name = "random_walk_load"
    title = "random-walk load torque"
    stage = Stage.LOAD
    equation = r"\tau_w = J w, \quad \dot w = \text{noise}"
    trace = "a residual torque that depends on neither angle nor velocity nor command, and never repeats"
    states = (State.RANDOM_WALK,)

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """What the observer has last made of it."""
        return at.inertia * state
