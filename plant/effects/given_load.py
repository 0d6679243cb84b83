"""A torque on the load that is given at each sample: by a log that has it, or by what a fit makes of the unmodelled.

It is not in the catalogue. Where it stands in a model its torque may be differentiated by.
"""

from __future__ import annotations

from dataclasses import dataclass

from plant.effects.effect import Effect, Expression, Moment, Stage, parameter


@dataclass(frozen=True, kw_only=True)
class GivenLoad(Effect):
    """Held over a sample."""

    name = "given_load"
    title = "given load torque"
    stage = Stage.LOAD
    equation = r"\tau_l = \text{given}"
    trace = "none: it is known"
    torque: float = parameter("{torque}", "torque on the load")

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """The same at every instant of a sample."""
        return self.torque
