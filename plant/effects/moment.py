"""The variables of an effect on the load at one instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

Expression: TypeAlias = Any  # a float, an array, or a CasADi SX while equations are built


@dataclass(frozen=True, kw_only=True)
class Moment:
    """The variables of an effect on the load, at one instant of an integration step, in numbers or symbols.

    Attributes:
        angle, velocity: of the load [rad, rad/s].
        torque: torque at the load, after actuator and drivetrain [N m].
        time: on the log's clock [s].
        travel: of the load since the step began [rad].
        step: length of the step [s].
        inertia: J of the model [N m s^2/rad].
    """

    angle: Expression = 0.0
    velocity: Expression = 0.0
    torque: Expression = 0.0
    time: Expression = 0.0
    travel: Expression = 0.0
    step: Expression = 0.0
    inertia: Expression = 1.0
