"""A physical parameter: its name, its unit on a rotary or linear axis, and its admissible values."""

from __future__ import annotations

import math
import re
from dataclasses import MISSING, dataclass, field, fields
from functools import lru_cache
from typing import Any, Literal, TypeAlias

from plant.errors import BadParameter
from plant.number import finite

Axis: TypeAlias = Literal["rotary", "linear"]

POSITIVE = 1e-30
"""Lower bound of a positive parameter, far below any machine's value in any unit."""

_UNITS = {"rotary": {"torque": "N m", "angle": "rad"}, "linear": {"torque": "N", "angle": "m"}}
_MASSES = {"N m s^2/rad": "kg m^2", "N s^2/m": "kg"}
_PER_ANGLE = {
    "{torque} s^2/{angle}": "s^2",
    "{torque} s^2/{angle}^2": "s^2/{angle}",
    "{torque} s/{angle}": "s",
    "{torque}/{angle}": "-",
    "{torque}/{angle}^3": "1/{angle}^2",
}  # unit of a parameter whose torque is counted in the angle of a position servo's error

_ON_LINEAR_AXIS = {
    "periods per turn": "phase per length",
    "angle from": "distance from",
    "angle": "position",
    "torque": "force",
    "inertia": "mass",
}
"""Words of a rotary axis in the meaning of a parameter, and those of a linear one."""

_LONGEST_LAG = 0.1  # fraction of a log


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One physical parameter: its meaning, its unit and its admissible values.

    `unit` is written in terms of {torque} and {angle}, so that it becomes N and m on a linear axis. A log only
    determines: an `instant` (on the log's clock) within it; a `swing` (angular frequency) that is slow enough for its
    samples and fast enough for its duration; a `lag` that is much shorter than the log; and nothing about a parameter
    that is not `fitted` but given.
    """

    name: str
    unit: str
    meaning: str
    lower: float = -math.inf
    upper: float = math.inf
    instant: bool = False
    swing: bool = False
    lag: bool = False
    fitted: bool = True

    def unit_on(self, axis: Axis, torque_unit: str | None = None) -> str:
        """The unit on a rotary or linear axis.

        Args:
            axis: of the model.
            torque_unit: unit that replaces that of the torque, such as "V" where its scale is unknown.
        """
        names = dict(_UNITS[axis])
        if torque_unit is None:
            unit = self.unit.format(**names)
            return _MASSES.get(unit, unit)
        unit = _PER_ANGLE.get(self.unit, self.unit) if torque_unit == names["angle"] else self.unit
        return unit.format(**{**names, "torque": torque_unit})

    def meaning_on(self, axis: Axis) -> str:
        """The meaning in the words of a rotary or linear axis."""
        words = _ON_LINEAR_AXIS if axis == "linear" else {}
        return re.sub("|".join(words), lambda found: words[found[0]], self.meaning) if words else self.meaning

    def bounds(self, first: float, last: float, sample_time: float) -> tuple[float, float]:
        """Bounds of values that a log can determine, from its first and last instant and its sample time [s]."""
        if self.instant:
            return first, last
        if self.swing:
            return max(self.lower, 2.0 / (last - first)), min(self.upper, fastest_swing(sample_time))
        return self.lower, min(self.upper, _LONGEST_LAG * (last - first)) if self.lag else self.upper

    def check(self, owner: str, value: Any) -> float:
        """The value as a float; raise `BadParameter` unless it is finite and within the bounds."""
        number = finite(value)
        if number is None:
            raise BadParameter(f"{owner}: {self.name} must be a finite number, not {value!r}.")
        if not self.lower <= number <= self.upper:
            raise BadParameter(f"{owner}: {self.name} = {number:g} is outside {self.lower:g} .. {self.upper:g}.")
        return number


def parameter(
    unit: str,
    meaning: str,
    *,
    lower: float = -math.inf,
    upper: float = math.inf,
    instant: bool = False,
    swing: bool = False,
    lag: bool = False,
    fitted: bool = True,
    default: Any = MISSING,
) -> Any:
    """A dataclass field with its `Parameter` as metadata; the field's name becomes the parameter's."""
    metadata = {
        "unit": unit,
        "meaning": meaning,
        "lower": lower,
        "upper": upper,
        "instant": instant,
        "swing": swing,
        "lag": lag,
        "fitted": fitted,
    }
    return field(metadata=metadata) if default is MISSING else field(default=default, metadata=metadata)


def fastest_swing(sample_time: float) -> float:
    """Highest angular frequency searched in a log [rad/s]: two radians a sample, below the Nyquist limit of pi."""
    return 2.0 / sample_time


def parameters_of(owner: Any) -> tuple[Parameter, ...]:
    """The parameters among the fields of a dataclass or an instance of it, in order."""
    return _of_kind(owner if isinstance(owner, type) else type(owner))


@lru_cache(maxsize=1024)
def _of_kind(kind: Any) -> tuple[Parameter, ...]:
    return tuple(Parameter(name=f.name, **f.metadata) for f in fields(kind) if "unit" in f.metadata)


def within(value: float, owner: type, name: str, *, floor: float = 0.0) -> float:
    """`value` clipped to the bounds of a parameter, and at least `floor` where the bound is below: a usable start."""
    spec = next(s for s in parameters_of(owner) if s.name == name)
    return float(min(max(value, spec.lower, floor), spec.upper))
