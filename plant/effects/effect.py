"""What an effect is: one physical cause that the simple servo model leaves out.

An effect acts at one stage on the way from command to measurement,

    command -> actuator -> drivetrain -> load -> sensor -> reading,

and overrides only the methods of what it does. Its methods are written once and
are called with numbers or with CasADi expressions alike: the fields of an effect
hold floats for the user and are exchanged for symbols when equations are built
(`bound`).

To add an effect: write one file beside this one and name the class in
`plant.effects.catalogue`. Simulation, fit, diagnosis, controller, saved models
and the report then know it.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import MISSING, dataclass, field, fields
from enum import StrEnum
from typing import Any, ClassVar, Literal, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plant.errors import BadParameter

Expression: TypeAlias = Any  # a float, an array, or a CasADi SX while equations are built
Axis: TypeAlias = Literal["rotary", "linear"]
Array: TypeAlias = NDArray[np.float64]

_UNITS = {"rotary": {"torque": "N m", "angle": "rad"}, "linear": {"torque": "N", "angle": "m"}}


class Stage(StrEnum):
    """Where on the way from command to measurement an effect acts."""

    ACTUATOR = "actuator"
    DRIVETRAIN = "drivetrain"
    LOAD = "load"
    SENSOR = "sensor"


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One physical parameter: what it means, its unit and the values that make sense.

    `unit` is written in terms of {torque} and {angle}, so that it reads N and m on a linear axis.
    """

    name: str
    unit: str
    meaning: str
    lower: float = -math.inf
    upper: float = math.inf

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
    unit: str, meaning: str, *, lower: float = -math.inf, upper: float = math.inf, default: Any = MISSING
) -> Any:
    """A dataclass field that carries its `Parameter`; the field's name becomes the parameter's."""
    metadata = {"unit": unit, "meaning": meaning, "lower": lower, "upper": upper}
    return field(metadata=metadata) if default is MISSING else field(default=default, metadata=metadata)


def parameters_of(owner: Any) -> tuple[Parameter, ...]:
    """The parameters among the fields of a dataclass or an instance of it, in order."""
    return tuple(Parameter(name=f.name, **f.metadata) for f in fields(owner) if "unit" in f.metadata)


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """What a fitted model did over one log, for an effect to say how its trace would look.

    Attributes:
        time: (T,) [s].
        angle: (T,) filtered load angle [rad].
        velocity: (T,) filtered load velocity [rad/s].
        torque: (T,) torque command after the drive's law [N m].
        score: (T,) how much a load torque at each sample would improve the fit: half the squared innovations that it
            would take away, per N m [rad^2/(N m)].
        run: (T,) index of the run of each sample.
        velocity_resolution: velocity below which its sign is not known [rad/s].
    """

    time: Array
    angle: Array
    velocity: Array
    torque: Array
    score: Array
    run: NDArray[np.intp]
    velocity_resolution: float

    @property
    def sample_time(self) -> float:
        """Median time step [s]."""
        return float(np.median(np.diff(self.time)))

    @property
    def sign(self) -> Array:
        """(T,) direction of motion, soft where the velocity is below its resolution."""
        return np.tanh(self.velocity / self.velocity_resolution)


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """The torque by which a small effect would show, at one choice of its shape.

    Attributes:
        columns: (T, m) torque on the load per unit of each coefficient [N m].
        start: the effect that coefficients (m,) found by regression suggest.
        positive: (m,) which coefficients cannot be negative; none by default.
        searched: how many shapes were compared to find this one (the search is charged for).
    """

    columns: Array
    start: Callable[[Array], Effect]
    positive: tuple[bool, ...] = ()
    searched: int = 1


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Base of all effects; by itself it does nothing."""

    name: ClassVar[str]
    title: ClassVar[str]
    stage: ClassVar[Stage]
    equation: ClassVar[str]
    trace: ClassVar[str]
    confused_with: ClassVar[tuple[str, ...]] = ()
    contains: ClassVar[tuple[str, ...]] = ()
    """Effects that are special cases of this one; it takes their place."""
    has_state: ClassVar[bool] = False
    axes: ClassVar[tuple[Axis, ...]] = ("rotary", "linear")

    def __post_init__(self) -> None:
        """Validate every parameter."""
        for spec in self.parameters():
            spec.check(self.name, getattr(self, spec.name))

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """The parameters, in the order of the fields."""
        return parameters_of(cls)

    @property
    def values(self) -> tuple[Expression, ...]:
        """The parameters' values, in order."""
        return tuple(getattr(self, spec.name) for spec in self.parameters())

    def bound(self, values: Sequence[Expression]) -> Self:
        """The same effect with other values, also symbolic ones, unchecked."""
        other = copy.copy(self)
        for spec, value in zip(self.parameters(), values, strict=True):
            object.__setattr__(other, spec.name, value)
        return other

    # What an effect can do; `h` is a time step [s] over which the command is constant.

    def delay(self) -> Expression:
        """Dead time of the command [s]."""
        return 0.0

    def advance(self, state: Expression, torque: Expression, h: Expression) -> Expression:
        """The effect's own state after `h` under a constant incoming torque."""
        return state

    def settling_time(self) -> Expression:
        """How long the effect's own state takes to follow a change [s]."""
        return 0.0

    def mean(self, state: Expression, torque: Expression, h: Expression) -> Expression:
        """Mean of the effect's own state over `h` under a constant incoming torque."""
        return state

    def command(self, torque: Expression, state: Expression) -> Expression:
        """The torque that leaves the effect when `torque` enters it [N m]."""
        return torque

    def load_torque(self, angle: Expression, velocity: Expression) -> Expression:
        """Smooth torque that the effect adds on the load [N m]."""
        return 0.0

    def dry_friction(self, velocity: Expression) -> tuple[Expression, Expression] | None:
        """Friction torque against forward and against backward motion [N m], both >= 0; at rest it holds up to them."""
        return None

    def reading(self, angle: Expression) -> Expression:
        """What the sensor shows when `angle` enters it [rad]."""
        return angle

    def reduced(self) -> tuple[Effect, ...]:
        """Its special cases, as they would be if its own parameters were right: where a refit of them may start."""
        return ()

    def vanishes(self, speed: float) -> bool:
        """Whether, in a log of that typical speed [rad/s], nothing shows that its special cases would not show too."""
        return False

    # How its trace looks.

    @classmethod
    def traces(cls, motion: Motion) -> Iterator[Trace]:
        """Traces of the effect over a motion, one for each shape worth trying."""
        raise NotImplementedError(f"{cls.__name__} does not say how its trace looks.")


def within(value: float, spec_owner: type[Effect], name: str, *, floor: float = 0.0) -> float:
    """`value` moved inside the bounds of a parameter, at least `floor` when the bound is below: a usable start."""
    spec = next(s for s in spec_owner.parameters() if s.name == name)
    return float(min(max(value, spec.lower, floor), spec.upper))
