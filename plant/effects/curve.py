"""A torque without a name: a curve over one variable, carried so that its gain is had before its cause is known.

These are no causes and not in the catalogue; a diagnosis adds one where it answers `unknown`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

import casadi as ca
import numpy as np

from plant.effects.effect import Array, Effect, Expression, Moment, Motion, Stage, Trace, parameter

KNOTS = 9
_REACH = 2.5  # knots over which a curve keeps its course
_APART = np.subtract.outer(np.arange(KNOTS), np.arange(KNOTS)) / _REACH
_SMOOTH = np.exp(-0.5 * _APART**2) + 1e-6 * np.eye(KNOTS)  # covariance of the knots before anything is seen
_DENSE = 0.05  # share of the range of velocity, about zero, within which the knots lie densest


@dataclass(frozen=True, kw_only=True)
class Curve(Effect):
    """A piecewise linear curve through nine knots between `low` and `high`, constant outside: it never extrapolates."""

    stage = Stage.LOAD
    equation = r"\tau_u = f(\cdot)"
    trace = "a smooth dependence of the missing torque"
    over: ClassVar[str]

    low: float = parameter("-", "lower end of the range")
    high: float = parameter("-", "upper end of the range")
    c0: float = parameter("{torque}", "torque at the lower end", default=0.0)
    c1: float = parameter("{torque}", "torque at knot 1", default=0.0)
    c2: float = parameter("{torque}", "torque at knot 2", default=0.0)
    c3: float = parameter("{torque}", "torque at knot 3", default=0.0)
    c4: float = parameter("{torque}", "torque at knot 4", default=0.0)
    c5: float = parameter("{torque}", "torque at knot 5", default=0.0)
    c6: float = parameter("{torque}", "torque at knot 6", default=0.0)
    c7: float = parameter("{torque}", "torque at knot 7", default=0.0)
    c8: float = parameter("{torque}", "torque at the upper end", default=0.0)

    @classmethod
    def shape(cls) -> tuple[str, ...]:
        """Names of the parameters that say where the knots are; they are not fitted."""
        return (f"{cls.name}.low", f"{cls.name}.high")

    @classmethod
    def place(cls, value: Expression, low: Expression, high: Expression) -> Expression:
        """Where a value lies among the knots, from 0 to 8."""
        return ca.fmax(ca.fmin((value - low) / (high - low), 1), 0) * (KNOTS - 1)

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """The curve at the load's variable."""
        place = self.place(getattr(at, self.over), self.low, self.high)
        return sum(value * ca.fmax(1 - ca.fabs(place - k), 0) for k, value in enumerate(self.values[2:]))

    @classmethod
    def traces(cls, motion: Motion) -> Iterator[Trace]:
        """One column for each knot."""
        values = cls.along(motion)
        low, high = (float(end) for end in np.quantile(values, [0.005, 0.995]))
        if high > low:
            place = np.array(cls.place(ca.DM(values), low, high)).ravel()
            hats = np.maximum(1.0 - np.abs(place[:, None] - np.arange(KNOTS)), 0.0)
            yield Trace(
                columns=hats,
                prior=_SMOOTH,
                start=lambda c: cls(low=low, high=high, **{f"c{k}": float(value) for k, value in enumerate(c)}),
            )

    @classmethod
    def along(cls, motion: Motion) -> Array:
        """(T,) the variable over a motion."""
        return np.asarray(getattr(motion, cls.over))


@dataclass(frozen=True, kw_only=True)
class CurveOverVelocity(Curve):
    """Over velocity, with most knots where friction changes: near zero."""

    name = "curve_over_velocity"
    title = "curve over velocity"
    over = "velocity"

    @classmethod
    def place(cls, value: Expression, low: Expression, high: Expression) -> Expression:
        """Evenly over asinh of the velocity."""
        scale = _DENSE * (high - low)
        return super().place(*(ca.asinh(v / scale) for v in (value, low, high)))


@dataclass(frozen=True, kw_only=True)
class CurveOverAngle(Curve):
    """Over the angle or position."""

    name = "curve_over_angle"
    title = "curve over angle"
    over = "angle"

    @classmethod
    def shape(cls) -> tuple[str, ...]:
        """Also gravity, which is itself such a curve."""
        return (*super().shape(), "gravity")


@dataclass(frozen=True, kw_only=True)
class CurveOverTorque(Curve):
    """Over the torque that arrives at the load."""

    name = "curve_over_torque"
    title = "curve over torque"
    over = "torque"

    @classmethod
    def shape(cls) -> tuple[str, ...]:
        """Also the inertia: beside a free curve of the torque only something of known size holds the scale."""
        return (*super().shape(), "inertia")

    @classmethod
    def along(cls, motion: Motion) -> Array:
        """(T,) what arrives of the torque."""
        return motion.arriving(motion.torque)


@dataclass(frozen=True, kw_only=True)
class CurveOverTime(Curve):
    """Over time on the log's clock; nothing of its course holds afterwards, and so nothing is left without a clock."""

    name = "curve_over_time"
    title = "curve over time"
    clocked = True
    over = "time"


curves: MappingProxyType[str, type[Curve]] = MappingProxyType(
    {cls.over: cls for cls in (CurveOverVelocity, CurveOverAngle, CurveOverTorque, CurveOverTime)}
)
"""The curves by the variable that they run over."""
