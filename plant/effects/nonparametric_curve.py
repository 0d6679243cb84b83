"""Non-parametric torque: a curve over one variable, which improves a model before its physical cause is known.

These effects are not physical causes and not in the catalogue; a diagnosis adds one when its answer is `unknown`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

import casadi as ca
import numpy as np

from plant.effects.effect import Array, Effect, Expression, Moment, Motion, Parameter, Regressors, Stage, parameter
from plant.effects.interpolation import interpolated, slopes_and_curvatures
from plant.recursion_cache import recursion

if TYPE_CHECKING:
    from plant.servo import ServoModel

KNOTS = 9
HEIGHTS = tuple(f"c{k}" for k in range(KNOTS))
_REACH = 2.5  # correlation length of a curve, in knots
_DENSE = 0.05  # fraction of the velocity range, about zero, with the densest knots


def smooth(knots: int, *, closed: bool = False) -> Array:
    """(knots, knots) prior covariance of the knots; `closed` if the last is next to the first."""
    apart = np.subtract.outer(np.arange(knots), np.arange(knots))
    turns = knots * np.arange(-2, 3) if closed else (0,)
    return np.asarray(sum(np.exp(-0.5 * ((apart + turn) / _REACH) ** 2) for turn in turns) + 1e-6 * np.eye(knots))


@dataclass(frozen=True, kw_only=True)
class Nonparametric(Effect):
    """Base of the non-parametric effects, defined only by the variables on which they depend."""

    variables: ClassVar[tuple[str, ...]]
    size: ClassVar[str] = "{torque}"
    """Unit of its coefficients."""

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """The parameters, with the coefficients in the unit `size`."""
        return tuple(replace(spec, unit=spec.unit.replace("{size}", cls.size)) for spec in super().parameters())

    @classmethod
    def on_the_load(cls) -> bool:
        """Whether it acts on the load, whatever the torque is: otherwise it would explain the torque by itself."""
        return super().on_the_load() and "torque" not in cls.variables

    @classmethod
    def shape(cls) -> tuple[str, ...]:
        """Names of parameters that are not fitted with it: its own range, and model parameters collinear with it."""
        return ()

    @classmethod
    def beside(cls, model: ServoModel) -> bool:
        """Whether it can be added to a model."""
        return model.axis in cls.axes and model.effect(cls.name) is None

    def begun(self) -> Self:
        """Start of a fit, from the values of a regression."""
        return self


@dataclass(frozen=True, kw_only=True)
class Curve(Nonparametric):
    """A piecewise cubic curve through nine knots between `low` and `high`, constant outside."""

    stage = Stage.LOAD
    equation = r"\tau_u = f(\cdot)"
    signature = "a smooth dependence of the residual torque"
    over: ClassVar[str]
    prior: ClassVar[Array] = smooth(KNOTS)

    low: float = parameter("-", "lower end of the range")
    high: float = parameter("-", "upper end of the range")
    c0: float = parameter("{size}", "height at the lower end", default=0.0)
    c1: float = parameter("{size}", "height at knot 1", default=0.0)
    c2: float = parameter("{size}", "height at knot 2", default=0.0)
    c3: float = parameter("{size}", "height at knot 3", default=0.0)
    c4: float = parameter("{size}", "height at knot 4", default=0.0)
    c5: float = parameter("{size}", "height at knot 5", default=0.0)
    c6: float = parameter("{size}", "height at knot 6", default=0.0)
    c7: float = parameter("{size}", "height at knot 7", default=0.0)
    c8: float = parameter("{size}", "height at the upper end", default=0.0)

    @classmethod
    def shape(cls) -> tuple[str, ...]:
        """The range of the knots is not fitted."""
        return (f"{cls.name}.low", f"{cls.name}.high")

    @classmethod
    def knots(cls, low: Expression, high: Expression) -> list[Expression]:
        """Values of the variable at the nine knots, from `low` to `high`."""
        return [low + k / (KNOTS - 1) * (high - low) for k in range(KNOTS)]

    @classmethod
    def course(
        cls, value: Expression, low: Expression, high: Expression, heights: Sequence[Expression] | Array
    ) -> Expression:
        """The curve with given heights (9,) at a value."""
        return interpolated(value, cls.knots(low, high), heights)

    @classmethod
    def hats(cls, values: Array, low: float, high: float) -> Array:
        """(T, 9) weight of each knot at each of the values (T,)."""
        hats = _hats(cls)
        return hats((), values[:, None], np.array([low, high]))[1][0]

    def height(self, at: Moment) -> Expression:
        """Height of the curve at the load's variable."""
        return self.course(getattr(at, self.over), self.low, self.high, self.values[2 : 2 + KNOTS])

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """The curve itself."""
        return self.height(at)

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """One column for each knot."""
        low, high = cls.reach(motion)
        if high > low:
            yield Regressors(
                columns=cls.hats(cls.along(motion), low, high) * cls.factor(motion)[:, None],
                prior=cls.prior,
                start=lambda c: cls(low=low, high=high, **dict(zip(HEIGHTS, map(float, c), strict=True))),
            )

    def begun(self) -> Self:
        """Flat: the heights of a regression are good only after the other parameters have been fitted."""
        return replace(self, **dict.fromkeys(HEIGHTS, 0.0))

    @classmethod
    def reach(cls, motion: Motion) -> tuple[float, float]:
        """The ends of the range of the knots."""
        low, high = np.quantile(cls.along(motion), [0.005, 0.995])
        return float(low), float(high)

    @classmethod
    def along(cls, motion: Motion) -> Array:
        """(T,) the variable over a motion."""
        return np.asarray(motion.arriving(motion.torque) if cls.over == "torque" else getattr(motion, cls.over))

    @classmethod
    def factor(cls, motion: Motion) -> Array:
        """(T,) factor from the curve to a torque on the load."""
        return np.ones_like(motion.time)


@recursion(carried=0)
def _hats(kind: type[Curve]) -> Any:
    """A value, the ends of the range -> (9,) derivatives of a kind of curve by its heights, in which it is linear."""
    value, ends, heights = ca.SX.sym("value"), ca.SX.sym("ends", 2), ca.SX.sym("heights", KNOTS)
    course = kind.course(value, ends[0], ends[1], ca.vertsplit(heights))
    counts = ca.densify(ca.jacobian(course, heights)).T
    return ca.Function("hats", [value, ends], [counts], {"cse": True})


@dataclass(frozen=True, kw_only=True)
class CurveOverVelocity(Curve):
    """Over velocity, with most knots near zero, where friction changes; extrapolated as friction.

    Friction is similar in both directions. If higher speeds were measured in one direction only, the curve of that
    direction is mirrored for the other. Beyond both, and between zero and a range that covers one direction only, the
    curve continues with the mean slope at its ends, weighted by their squared distance from zero: its viscous part
    belongs to the viscous friction of the model, and flat ends would absorb some of that.
    """

    name = "curve_over_velocity"
    title = "curve over velocity"
    over = "velocity"
    variables = ("velocity",)

    @classmethod
    def shape(cls) -> tuple[str, ...]:
        """Also viscous friction, which is a special case of the curve."""
        return (*super().shape(), "viscous_friction")

    @classmethod
    def beside(cls, model: ServoModel) -> bool:
        """Only one curve over velocity, with or without dry friction."""
        return super().beside(model) and not any(isinstance(effect, CurveOverVelocity) for effect in model.effects)

    @classmethod
    def knots(cls, low: Expression, high: Expression) -> list[Expression]:
        """Equally spaced over asinh of the velocity."""
        scale = _DENSE * (high - low)
        inner = super().knots(*(ca.asinh(end / scale) for end in (low, high)))[1:-1]
        return [low, *(scale * ca.sinh(place) for place in inner), high]

    @classmethod
    def course(
        cls, value: Expression, low: Expression, high: Expression, heights: Sequence[Expression] | Array
    ) -> Expression:
        """Inside as for any curve; outside mirrored from the other direction, and beyond that linear."""
        knots = cls.knots(low, high)

        def within(at: Expression) -> Expression:
            return super(CurveOverVelocity, cls).course(at, low, high, heights)

        rises, curvatures = slopes_and_curvatures(knots, heights)
        first, last = rises[0] - (knots[1] - low) * curvatures[0], rises[-1] + (high - knots[-2]) * curvatures[-1]
        slope = (low**2 * first + high**2 * last) / (low**2 + high**2)
        farther = ca.fmax(-low, high)
        beyond = value - ca.fmax(ca.fmin(value, farther), -farther)
        slowest = ca.fmax(low, 0) + ca.fmin(high, 0)  # in the log, if in one direction only
        between = ca.fmax(ca.fmin(value, ca.fabs(slowest)), -ca.fabs(slowest)) - slowest
        above, below = value > high, value < low
        outside = ca.logic_or(above, below)
        at_the_end = above * (heights[-1] + within(-high)) + below * (heights[0] + within(-low))
        sign = 1 - 2 * outside  # outside, the mirrored curve of the other direction
        return at_the_end + sign * within(sign * value) + slope * (beyond + between)


@dataclass(frozen=True, kw_only=True)
class CurveOverAngle(Curve):
    """Over the angle or position."""

    name = "curve_over_angle"
    title = "curve over angle"
    over = "angle"
    needs_angle = True
    variables = ("angle",)

    @classmethod
    def shape(cls) -> tuple[str, ...]:
        """Also gravity, which is a special case of the curve."""
        return (*super().shape(), "gravity")


@dataclass(frozen=True, kw_only=True)
class CurveOverTorque(Curve):
    """Over the torque at the load."""

    name = "curve_over_torque"
    title = "curve over torque"
    over = "torque"
    variables = ("torque",)

    @classmethod
    def shape(cls) -> tuple[str, ...]:
        """Also the inertia: with a free curve over the torque, only a fixed inertia defines the scale."""
        return (*super().shape(), "inertia")


@dataclass(frozen=True, kw_only=True)
class CurveOverTime(Curve):
    """Over time on the log's clock; it is not valid after the log, so nothing remains without a clock."""

    name = "curve_over_time"
    title = "curve over time"
    clocked = True
    over = "time"
    variables = ("time",)
