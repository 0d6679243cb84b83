"""The catalogue of effects: one file each, listed here in the order in which the command meets them."""

from __future__ import annotations

from types import MappingProxyType

from plant.effects.actuator_lag import ActuatorLag
from plant.effects.asymmetric_friction import AsymmetricFriction
from plant.effects.cogging import Cogging
from plant.effects.coulomb_friction import CoulombFriction
from plant.effects.dead_zone import DeadZone
from plant.effects.effect import Axis, Effect, Expression, Moment, Motion, Parameter, Stage, State, Trace
from plant.effects.gravity_offset import GravityOffset
from plant.effects.input_delay import InputDelay
from plant.effects.quadratic_drag import QuadraticDrag
from plant.effects.stribeck_friction import StribeckFriction
from plant.effects.torque_offset import TorqueOffset

_ALONG_THE_WAY: tuple[type[Effect], ...] = (
    InputDelay,
    ActuatorLag,
    DeadZone,
    TorqueOffset,
    CoulombFriction,
    AsymmetricFriction,
    StribeckFriction,
    QuadraticDrag,
    GravityOffset,
    Cogging,
)

catalogue: MappingProxyType[str, type[Effect]] = MappingProxyType({cls.name: cls for cls in _ALONG_THE_WAY})
"""Every effect by its name."""

__all__ = [
    "ActuatorLag",
    "AsymmetricFriction",
    "Axis",
    "Cogging",
    "CoulombFriction",
    "DeadZone",
    "Effect",
    "Expression",
    "GravityOffset",
    "InputDelay",
    "Moment",
    "Motion",
    "Parameter",
    "QuadraticDrag",
    "Stage",
    "State",
    "StribeckFriction",
    "TorqueOffset",
    "Trace",
    "catalogue",
]
