"""Torque offset: a constant bias of the drive."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from plant.effects.effect import Effect, Expression, Motion, Regressors, Stage, parameter


@dataclass(frozen=True, kw_only=True)
class TorqueOffset(Effect):
    """A constant torque that the command does not contain: current sensor bias, unbalanced amplifier."""

    name = "torque_offset"
    title = "torque offset"
    stage = Stage.ACTUATOR
    equation = r"\tau \leftarrow \tau + \tau_0"
    signature = "residual torque: constant"
    confused_with = ("gravity_offset", "asymmetric_friction", "cable_stiffness")

    torque: float = parameter("{torque}", "constant bias")

    @classmethod
    def on_the_load(cls) -> bool:
        """A bias of the measured torque acts like a load."""
        return True

    def command(self, torque: Expression, state: Expression, velocity: Expression) -> Expression:
        """The torque plus the bias, which acts after the dead zone and is not reduced by it."""
        return torque + self.torque

    def command_for(self, torque: Expression, velocity: Expression) -> Expression:
        """The torque less the bias."""
        return torque - self.torque

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """A constant."""
        yield Regressors(columns=np.ones((motion.time.size, 1)), start=lambda c: cls(torque=float(c[0])))
