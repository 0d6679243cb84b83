"""The catalogue of effects: one file each, listed in the order in which they act between command and measurement."""

from __future__ import annotations

from types import MappingProxyType
from typing import Any

from plant.effects.actuator_lag import ActuatorLag
from plant.effects.asymmetric_friction import AsymmetricFriction
from plant.effects.back_emf import BackEmf
from plant.effects.backlash import Backlash
from plant.effects.cable_stiffness import CableStiffness
from plant.effects.cogging import Cogging
from plant.effects.compliance import Compliance
from plant.effects.coulomb_friction import CoulombFriction
from plant.effects.dead_zone import DeadZone
from plant.effects.effect import Axis, Effect, Expression, Moment, Motion, Parameter, Regressors, Stage, State
from plant.effects.encoder_eccentricity import EncoderEccentricity
from plant.effects.end_stop import EndStop
from plant.effects.friction_drift import FrictionDrift
from plant.effects.gravity_offset import GravityOffset
from plant.effects.input_delay import InputDelay
from plant.effects.load_dependent_friction import LoadDependentFriction
from plant.effects.payload_change import PayloadChange
from plant.effects.periodic_disturbance import PeriodicDisturbance
from plant.effects.presliding_hysteresis import PreslidingHysteresis
from plant.effects.quadratic_drag import QuadraticDrag
from plant.effects.rate_limit import RateLimit
from plant.effects.sensor_lag import SensorLag
from plant.effects.setpoint_rate_limit import SetpointRateLimit
from plant.effects.stribeck_friction import StribeckFriction
from plant.effects.torque_measurement_lag import TorqueMeasurementLag
from plant.effects.torque_offset import TorqueOffset
from plant.effects.torque_saturation import TorqueSaturation
from plant.renamed import warn_of

_ALONG_THE_WAY: tuple[type[Effect], ...] = (
    TorqueMeasurementLag,
    InputDelay,
    SetpointRateLimit,
    RateLimit,
    ActuatorLag,
    TorqueSaturation,
    BackEmf,
    DeadZone,
    TorqueOffset,
    Compliance,
    Backlash,
    LoadDependentFriction,
    CoulombFriction,
    AsymmetricFriction,
    StribeckFriction,
    PreslidingHysteresis,
    QuadraticDrag,
    GravityOffset,
    CableStiffness,
    Cogging,
    EndStop,
    PayloadChange,
    PeriodicDisturbance,
    FrictionDrift,
    EncoderEccentricity,
    SensorLag,
)

catalogue: MappingProxyType[str, type[Effect]] = MappingProxyType({cls.name: cls for cls in _ALONG_THE_WAY})
"""All effects of the catalogue, by name."""


def __getattr__(name: str) -> Any:
    """The class of signatures under its old name."""
    if name == "Trace":
        warn_of(name, "Regressors")
        return Regressors
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = [
    "ActuatorLag",
    "AsymmetricFriction",
    "Axis",
    "BackEmf",
    "Backlash",
    "CableStiffness",
    "Cogging",
    "Compliance",
    "CoulombFriction",
    "DeadZone",
    "Effect",
    "EncoderEccentricity",
    "EndStop",
    "Expression",
    "FrictionDrift",
    "GravityOffset",
    "InputDelay",
    "LoadDependentFriction",
    "Moment",
    "Motion",
    "Parameter",
    "PayloadChange",
    "PeriodicDisturbance",
    "PreslidingHysteresis",
    "QuadraticDrag",
    "RateLimit",
    "Regressors",
    "SensorLag",
    "SetpointRateLimit",
    "Stage",
    "State",
    "StribeckFriction",
    "TorqueMeasurementLag",
    "TorqueOffset",
    "TorqueSaturation",
    "catalogue",
]
