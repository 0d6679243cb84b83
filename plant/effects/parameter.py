"""A physical parameter: its name, its unit on a rotary or linear axis, and the values that make sense."""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, Literal, TypeAlias

from plant.errors import BadParameter

Axis: TypeAlias = Literal["rotary", "linear"]

_UNITS = {"rotary": {"torque": "N m", "angle": "rad"}, "linear": {"torque": "N", "angle": "m"}}


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One physical parameter: what it means, its unit and the values that make sense.

    `unit` is written in terms of {torque} and {angle}, so that it reads N and m on a linear axis. An `instant` is on
    the log's clock: a log says nothing of one outside it.
    """

    name: str
    unit: str
    meaning: str
    lower: float = -math.inf
    upper: float = math.inf
    instant: bool = False

    def unit_on(self, axis: Axis) -> str:
        """The unit on a rotary or linear axis."""
        unit = self.unit.format(**_UNITS[axis])
        return {"N m s^2/rad": "kg m^2", "N s^2/m": "kg"}.get(unit, unit)

    def check(self, owner: str, value: float) -> None:
        """Raise `BadParameter` unless `value` is finite and within the bounds."""
        if not (isinstance(value, (int, float)) and math.isfinite(value)):
            raise BadParameter(f"{owner}: {self.name} must be a finite number, not {value!r}.")
        if not self.lower <= value <= self.upper:
            raise BadParameter(f"{owner}: {self.name} = {value:g} is outside {self.lower:g} .. {self.upper:g}.")


def parameter(
    unit: str,
    meaning: str,
    *,
    lower: float = -math.inf,
    upper: float = math.inf,
    instant: bool = False,
    default: Any = MISSING,
) -> Any:
    """A dataclass field that carries its `Parameter`; the field's name becomes the parameter's."""
    metadata = {"unit": unit, "meaning": meaning, "lower": lower, "upper": upper, "instant": instant}
    return field(metadata=metadata) if default is MISSING else field(default=default, metadata=metadata)


def parameters_of(owner: Any) -> tuple[Parameter, ...]:
    """The parameters among the fields of a dataclass or an instance of it, in order."""
    return tuple(Parameter(name=f.name, **f.metadata) for f in fields(owner) if "unit" in f.metadata)


def within(value: float, owner: type, name: str, *, floor: float = 0.0) -> float:
    """`value` moved inside the bounds of a parameter, at least `floor` when the bound is below: a usable start."""
    spec = next(s for s in parameters_of(owner) if s.name == name)
    return float(min(max(value, spec.lower, floor), spec.upper))
