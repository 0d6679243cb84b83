"""A random-walk load torque: a disturbance without a physical effect, for which a model must not be extended.

It is not in the catalogue. An observer gets a third state by it; a simulation ignores it.
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
        """The observer's present estimate."""
        return at.inertia * state
