"""A torque on the load that is given at each sample, by the log or by the unmodelled torque of a fit.

It is not in the catalogue. The model can be differentiated with respect to this torque.
"""

from __future__ import annotations

from dataclasses import dataclass

from plant.effects.effect import Effect, Expression, Moment, Stage, parameter


@dataclass(frozen=True, kw_only=True)
class GivenLoad(Effect):
    """A load torque held over a sample."""

    name = "given_load"
    title = "given load torque"
    stage = Stage.LOAD
    equation = r"\tau_l = \text{given}"
    signature = "none: it is known"
    torque: float = parameter("{torque}", "torque on the load")

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """The given torque, constant within a sample."""
        return self.torque
