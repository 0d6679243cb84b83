"""A non-parametric ripple: a Fourier series over angle or time, as `plant.effects.nonparametric_curve`.

The catalogue's periodic effects are single sines. Ripple of gears, bearings or a neighbouring machine seldom is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import casadi as ca
import numpy as np

from plant.effects.effect import Array, Expression, Moment, Motion, Regressors, Stage, parameter
from plant.effects.nonparametric_curve import Nonparametric
from plant.effects.spectral_lines import lines_over_angle, lines_over_time, waves

HARMONICS = 4
_PRIOR = np.diag(np.repeat(1.0 / np.arange(1, HARMONICS + 1) ** 2, 2))  # higher harmonics are smaller


@dataclass(frozen=True, kw_only=True)
class Ripple(Nonparametric):
    """Four harmonics of a fundamental, whose rate is fitted too; their unit is that of the torque or angle."""

    equation = r"f = \sum_{k=1}^{4} a_k \sin(k n s) + b_k \cos(k n s)"
    signature = "order lines and their harmonics"
    multimodal = True
    periodic = True

    rate: float = parameter("-", "fundamental n [rad per unit of the variable]", lower=0.0)
    s1: float = parameter("{size}", "sine of the fundamental", default=0.0)
    c1: float = parameter("{size}", "cosine of the fundamental", default=0.0)
    s2: float = parameter("{size}", "sine of harmonic 2", default=0.0)
    c2: float = parameter("{size}", "cosine of harmonic 2", default=0.0)
    s3: float = parameter("{size}", "sine of harmonic 3", default=0.0)
    c3: float = parameter("{size}", "cosine of harmonic 3", default=0.0)
    s4: float = parameter("{size}", "sine of harmonic 4", default=0.0)
    c4: float = parameter("{size}", "cosine of harmonic 4", default=0.0)

    def height(self, place: Expression) -> Expression:
        """The ripple at a value of its variable."""
        turns = [k * self.rate * place for k in range(1, HARMONICS + 1)]
        waves = [wave for turn in turns for wave in (ca.sin(turn), ca.cos(turn))]
        return sum(size * wave for size, wave in zip(self.values[1:], waves, strict=True))

    @classmethod
    def along(cls, motion: Motion) -> Array:
        """(T,) the variable over a motion."""
        return motion.angle

    @classmethod
    def lines(cls, motion: Motion) -> tuple[list[float], int]:
        """Candidate rates of the fundamental, and the number of rates compared."""
        return lines_over_angle(motion)

    @classmethod
    def regressors(cls, motion: Motion) -> Iterator[Regressors]:
        """Sines and cosines at the harmonics of the strongest lines."""
        place = cls.along(motion)
        rates, searched = cls.lines(motion)
        for rate in rates:
            yield Regressors(
                columns=np.hstack([waves(place, k * rate) for k in range(1, HARMONICS + 1)]),
                prior=_PRIOR,
                start=lambda c, rate=rate: cls(rate=rate, **dict(zip(_names(cls), map(float, c), strict=True))),  # type: ignore[misc]
                acts_on="measurement" if cls.stage == Stage.SENSOR else "torque",
                searched=searched,
            )


def _names(kind: type[Ripple]) -> list[str]:
    return [spec.name for spec in kind.parameters()[1:]]


@dataclass(frozen=True, kw_only=True)
class RippleOverAngle(Ripple):
    """A torque that repeats with the angle."""

    name = "ripple_over_angle"
    title = "ripple over the angle"
    stage = Stage.LOAD
    variables = ("angle",)

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """The ripple."""
        return self.height(at.angle)


@dataclass(frozen=True, kw_only=True)
class RippleOverTime(Ripple):
    """A torque that repeats in time."""

    name = "ripple_over_time"
    title = "ripple over time"
    stage = Stage.LOAD
    variables = ("time",)
    clocked = True

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        """The ripple."""
        return self.height(at.time)

    @classmethod
    def along(cls, motion: Motion) -> Array:
        """(T,) middle of the samples over which a torque acts."""
        return motion.time + 0.5 * motion.sample_time

    @classmethod
    def lines(cls, motion: Motion) -> tuple[list[float], int]:
        """As for a disturbance that is a single sine."""
        return lines_over_time(motion)


@dataclass(frozen=True, kw_only=True)
class RippleOfReading(Ripple):
    """A measurement error of the encoder that repeats with the angle, once per turn of its disc or faster."""

    name = "ripple_of_reading"
    title = "measurement error that repeats with the angle"
    stage = Stage.SENSOR
    size = "{angle}"
    variables = ("angle",)

    def measurement(self, angle: Expression, state: Expression) -> Expression:
        """The angle plus its error."""
        return angle + self.height(angle)

    @classmethod
    def lines(cls, motion: Motion) -> tuple[list[float], int]:
        """One period per turn, and the rates at which a measurement error would improve the fit most."""
        found, searched = lines_over_angle(motion, "measurement")
        return [*([1.0] if motion.turn and np.ptp(motion.angle) > 1.0 else []), *found], searched


ripples: Mapping[str, type[Ripple]] = MappingProxyType(
    {kind.name: kind for kind in (RippleOverAngle, RippleOverTime, RippleOfReading)}
)
"""The ripples by name."""
