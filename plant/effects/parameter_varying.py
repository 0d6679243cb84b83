"""A law whose size varies: friction, damping, torque or weight times a curve over another variable.

Most laws of two variables are of this kind: friction that changes with position or load, a torque transmission that
changes with position. They are non-parametric, as in `nonparametric_curve` (Hastie and Tibshirani 1993 on varying
coefficients).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Self

import casadi as ca
import numpy as np

from plant.effects.effect import Array, Expression, Moment, Motion
from plant.effects.interpolation import interpolated
from plant.effects.nonparametric_curve import HEIGHTS, KNOTS, Curve, smooth


@dataclass(frozen=True, kw_only=True)
class OverTurn(Curve):
    """A curve over one turn of the load, for a load that makes several turns."""

    over = "angle"
    prior = smooth(KNOTS, closed=True)
    axes = ("rotary",)

    @classmethod
    def course(
        cls, value: Expression, low: Expression, high: Expression, heights: Sequence[Expression] | Array
    ) -> Expression:
        """A periodic curve, the last knot next to the first."""
        turns = (value - low) / (high - low)
        around = range(-1, KNOTS + 2)
        return interpolated((turns - ca.floor(turns)) * KNOTS, around, [heights[k % KNOTS] for k in around])

    @classmethod
    def reach(cls, motion: Motion) -> tuple[float, float]:
        """One turn, if the load makes more than one."""
        return 0.0, 2.0 * np.pi if np.ptp(motion.angle) > 2.0 * np.pi else 0.0


@dataclass(frozen=True, kw_only=True)
class VaryingFriction(Curve):
    """Dry friction, the same in both directions; the curve is its level."""

    equation = r"\tau_u \in -\max(0, f(\cdot))\,\mathrm{sgn}(\dot x)"

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """No smooth torque."""
        return 0.0

    def dry_friction(self, at: Moment) -> tuple[Expression, Expression]:
        """As high as the curve, at least zero."""
        level = ca.fmax(self.height(at), 0)
        return level, level

    def begun(self) -> Self:
        """Raised until no height is negative, where it has no influence; a constant friction compensates for it."""
        least = min(0.0, *(getattr(self, name) for name in HEIGHTS))
        return replace(self, **{name: getattr(self, name) - least for name in HEIGHTS})

    @classmethod
    def factor(cls, motion: Motion) -> Array:
        """Against the motion."""
        return -motion.sign


@dataclass(frozen=True, kw_only=True)
class FrictionOverAngle(VaryingFriction):
    """Friction that changes with the position."""

    name = "friction_over_angle"
    title = "friction that varies with the angle"
    over = "angle"
    variables = ("angle", "velocity")


@dataclass(frozen=True, kw_only=True)
class FrictionOverTurn(OverTurn, VaryingFriction):
    """Friction that repeats with each turn."""

    name = "friction_over_turn"
    title = "friction that varies over a turn"
    variables = ("angle", "velocity")


@dataclass(frozen=True, kw_only=True)
class FrictionOverTorque(VaryingFriction):
    """Friction that changes with the torque at the load."""

    name = "friction_over_torque"
    title = "friction that varies with the torque"
    over = "torque"
    variables = ("torque", "velocity")


@dataclass(frozen=True, kw_only=True)
class FrictionOverTime(VaryingFriction):
    """Friction that changes in time."""

    name = "friction_over_time"
    title = "friction that varies in time"
    over = "time"
    variables = ("time", "velocity")
    clocked = True


@dataclass(frozen=True, kw_only=True)
class VaryingDamping(Curve):
    """A torque against the velocity; the curve is its coefficient."""

    equation = r"\tau_u = -f(\cdot)\,\dot x"
    size = "{torque} s/{angle}"

    @classmethod
    def shape(cls) -> tuple[str, ...]:
        """Also the constant damping."""
        return (*super().shape(), "viscous_friction")

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """Against the motion."""
        return -self.height(at) * at.velocity

    @classmethod
    def factor(cls, motion: Motion) -> Array:
        """Against the motion."""
        return -motion.velocity


@dataclass(frozen=True, kw_only=True)
class DampingOverAngle(VaryingDamping):
    """Damping that changes with the position."""

    name = "damping_over_angle"
    title = "damping that varies with the angle"
    over = "angle"
    variables = ("angle", "velocity")


@dataclass(frozen=True, kw_only=True)
class DampingOverTurn(OverTurn, VaryingDamping):
    """Damping that repeats with each turn."""

    name = "damping_over_turn"
    title = "damping that varies over a turn"
    variables = ("angle", "velocity")


@dataclass(frozen=True, kw_only=True)
class DampingOverTime(VaryingDamping):
    """Damping that changes in time."""

    name = "damping_over_time"
    title = "damping that varies in time"
    over = "time"
    variables = ("time", "velocity")
    clocked = True


@dataclass(frozen=True, kw_only=True)
class VaryingTorque(Curve):
    """A torque in proportion to the torque at the load; the curve is the factor."""

    equation = r"\tau_u = f(\cdot)\,\tau_l"
    size = "-"

    @classmethod
    def shape(cls) -> tuple[str, ...]:
        """Also the inertia, which a constant factor would scale."""
        return (*super().shape(), "inertia")

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """The factor times the torque."""
        return self.height(at) * at.torque

    @classmethod
    def factor(cls, motion: Motion) -> Array:
        """The torque at the load."""
        return motion.arriving(motion.torque)


@dataclass(frozen=True, kw_only=True)
class TorqueOverAngle(VaryingTorque):
    """A torque factor that changes with the position."""

    name = "torque_over_angle"
    title = "torque whose share varies with the angle"
    over = "angle"
    variables = ("angle", "torque")


@dataclass(frozen=True, kw_only=True)
class TorqueOverTurn(OverTurn, VaryingTorque):
    """A torque factor that repeats with each turn: a transmission ratio that is not constant."""

    name = "torque_over_turn"
    title = "torque whose share varies over a turn"
    variables = ("angle", "torque")


@dataclass(frozen=True, kw_only=True)
class TorqueOverTime(VaryingTorque):
    """A torque factor that changes in time."""

    name = "torque_over_time"
    title = "torque whose share varies in time"
    over = "time"
    variables = ("time", "torque")
    clocked = True


@dataclass(frozen=True, kw_only=True)
class GravityOverTime(Curve):
    """A gravity torque that changes in time."""

    name = "gravity_over_time"
    title = "weight that varies in time"
    equation = r"\tau_u = -f(t) \cos x"
    over = "time"
    variables = ("time", "angle")
    clocked = True
    axes = ("rotary",)

    @classmethod
    def shape(cls) -> tuple[str, ...]:
        """Also the constant gravity."""
        return (*super().shape(), "gravity")

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """Counted like gravity in eq. (4)."""
        return -self.height(at) * ca.cos(at.angle)

    @classmethod
    def factor(cls, motion: Motion) -> Array:
        """Counted like gravity in eq. (4)."""
        return -np.cos(motion.angle)


_KINDS = (
    FrictionOverAngle,
    FrictionOverTurn,
    FrictionOverTorque,
    FrictionOverTime,
    DampingOverAngle,
    DampingOverTurn,
    DampingOverTime,
    TorqueOverAngle,
    TorqueOverTurn,
    TorqueOverTime,
    GravityOverTime,
)
varying: Mapping[str, type[Curve]] = MappingProxyType({kind.name: kind for kind in _KINDS})
"""The varying laws by name."""
