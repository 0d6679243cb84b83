"""All non-parametric effects of a model: curves, laws whose size varies, hysteresis, lag and ripples."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from plant.effects.effect import Stage
from plant.effects.friction_over_velocity import FrictionOverVelocity
from plant.effects.hysteresis import Hysteresis
from plant.effects.lagged_torque import LaggedTorque
from plant.effects.nonparametric_curve import (
    Curve,
    CurveOverAngle,
    CurveOverTime,
    CurveOverTorque,
    CurveOverVelocity,
    Nonparametric,
)
from plant.effects.parameter_varying import varying
from plant.effects.ripple import ripples

_CURVES = (CurveOverVelocity, FrictionOverVelocity, CurveOverAngle, CurveOverTorque, CurveOverTime)
plain: Mapping[str, type[Curve]] = MappingProxyType({curve.name: curve for curve in _CURVES})
"""Curves of a torque over one variable, by name."""

unnamed: Mapping[str, type[Nonparametric]] = MappingProxyType(
    {**plain, **varying, Hysteresis.name: Hysteresis, LaggedTorque.name: LaggedTorque, **ripples}
)
"""All non-parametric effects, by name."""

of_reading = frozenset(name for name, kind in unnamed.items() if kind.stage is Stage.SENSOR)
"""Names of those that are measurement errors."""
