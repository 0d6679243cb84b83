"""A fan on the shaft: an effect as its owner writes it, in a file of its own.

Read by path, as `--effects` does.
"""

from __future__ import annotations

from dataclasses import dataclass

from plant import Effect
from plant.effects import Regressors, Stage
from plant.effects.effect import parameter, within


@dataclass(frozen=True, kw_only=True)
class Windage(Effect):
    """A torque that grows with the cube of the speed."""

    name = "windage"
    title = "windage"
    stage = Stage.LOAD
    equation = r"\tau_w = -c \dot x^3"
    signature = "cubic over velocity"
    confused_with = ("quadratic_drag",)
    drag: float = parameter("{torque} s^3/{angle}^3", "drag c", lower=0.0)

    def load_torque(self, at, state):
        """Against the motion."""
        return -self.drag * at.velocity**3

    @classmethod
    def regressors(cls, motion):
        """One column."""
        yield Regressors(
            columns=-(motion.velocity**3)[:, None],
            positive=(True,),
            start=lambda found: cls(drag=within(found[0], cls, "drag")),
        )
