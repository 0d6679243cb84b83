"""The servo model: inertia, gravity, viscous friction and a tuple of effects (paper, eqs. 4 and 6)."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self, get_args

import numpy as np
from numpy.typing import ArrayLike

from plant.effects import DeadZone, Effect
from plant.effects.effect import (
    POSITIVE,
    Array,
    Axis,
    Expression,
    Moment,
    Parameter,
    State,
    parameter,
    parameters_of,
)
from plant.errors import BadParameter
from plant.result_display import Tabled
from plant.units import printed

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True)
class ServoModel(Tabled):
    """One load on one axis, driven by a torque.

        J x'' = -alpha cos x - K x' + h(tau) + torques of the effects        (paper, eqs. 4 and 6)

    Attributes:
        inertia: J [N m s^2/rad = kg m^2; kg on a linear axis].
        gravity: alpha, torque of gravity at angle zero [N m]; zero on a linear axis.
        viscous_friction: K [N m s/rad; N s/m].
        effects: additional effects; at most one of a kind.
        axis: "rotary" (rad, N m) or "linear" (m, N).
        torque_unit: unit of the torque if its scale is unknown, such as "V" or "A"; None is N m, or N.

    Raises:
        BadParameter: a parameter is not finite or out of its bounds, or effects appear twice or exclude each other.
    """

    inertia: float = parameter("{torque} s^2/{angle}", "inertia J", lower=POSITIVE, default=2.0)
    gravity: float = parameter("{torque}", "gravity torque alpha", default=0.5)
    viscous_friction: float = parameter("{torque} s/{angle}", "viscous friction K", lower=0.0, default=0.8)
    effects: tuple[Effect, ...] = ()
    axis: Axis = "rotary"
    torque_unit: str | None = None

    _internal: ClassVar[frozenset[str]] = Tabled._internal | {
        *("bound", "chaotic", "commanded", "delay", "drivetrain", "dry_friction", "holds"),
        *(
            "kinds",
            "lead",
            "load_inertia",
            "longest_step",
            "own_states",
            "measurement",
            "parameters_with",
            "quantities",
        ),
        *("slides", "smooth_acceleration", "states", "structure", "without_clock"),
    }

    def __post_init__(self) -> None:
        """Validate everything, and sort the effects in the catalogue's order."""
        from plant.effects import catalogue

        if self.axis not in get_args(Axis):
            raise BadParameter(f"ServoModel: axis must be 'rotary' or 'linear', not {self.axis!r}.")
        for spec in parameters_of(type(self)):
            object.__setattr__(self, spec.name, spec.check("ServoModel", getattr(self, spec.name)))
        if self.torque_unit is not None and not (isinstance(self.torque_unit, str) and self.torque_unit.strip()):
            raise BadParameter(
                f"ServoModel: torque_unit must be a unit such as 'V', or None, not {self.torque_unit!r}."
            )
        if self.torque_unit == {"rotary": "N m", "linear": "N"}[self.axis]:
            object.__setattr__(self, "torque_unit", None)
        if self.axis == "linear" and self.gravity != 0.0:
            raise BadParameter("ServoModel: a linear axis has no gravity cos x; set gravity to 0.")
        if sum(effect.flexible for effect in self.effects) > 1:
            raise BadParameter("ServoModel: only one effect can put a motor before the load.")
        names = [effect.name for effect in self.effects]
        if len(set(names)) != len(names):
            raise BadParameter(f"ServoModel: an effect appears twice among {', '.join(names)}.")
        for effect in self.effects:
            if before := sorted(set(names) & set(effect.measured)):
                raise BadParameter(
                    f"ServoModel: {', '.join(before)} cannot stand beside {effect.name}, because a measured torque is "
                    "already behind it; leave one of them out."
                )
        order = {name: place for place, name in enumerate(catalogue)}
        ordered = tuple(sorted(self.effects, key=lambda effect: order.get(effect.name, len(order))))
        object.__setattr__(self, "effects", ordered)

    @classmethod
    def paper(cls) -> Self:
        """J = 2, alpha = 0.5, K = 0.8 and the dead zone of 0.5 (paper, sections 3.2 and 4)."""
        return cls(inertia=2.0, gravity=0.5, viscous_friction=0.8, effects=(DeadZone(half_width=0.5),))

    # The parameters as a flat vector, first those of the rigid body, then those of the effects: the variables of a fit.

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters in order; those of an effect are named `effect.parameter`."""
        own = tuple(self._on_axis(spec, spec.name) for spec in parameters_of(type(self)))
        theirs = (
            replace(spec, fitted=spec.fitted or effect.freed)
            for effect in self.effects
            for spec in self.parameters_with(type(effect))
        )
        return own + tuple(theirs)

    def parameters_with(self, effect: type[Effect]) -> tuple[Parameter, ...]:
        """The parameters of an effect of that kind, named `effect.parameter`."""
        return tuple(self._on_axis(spec, f"{effect.name}.{spec.name}") for spec in effect.parameters())

    def _on_axis(self, spec: Parameter, name: str) -> Parameter:
        unit, meaning = spec.unit_on(self.axis, self.torque_unit), spec.meaning_on(self.axis)
        return replace(spec, name=name, unit=unit, meaning=meaning)

    @cached_property
    def quantities(self) -> tuple[str, ...]:
        """(P,) units of the parameters with the torque in N m, or N: the physical quantity of each of them."""
        specs = replace(self, torque_unit=None).parameters if self.torque_unit else self.parameters
        return tuple(spec.unit for spec in specs)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters, in order."""
        return tuple(spec.name for spec in self.parameters)

    @property
    def values(self) -> Array:
        """(P,) values of all parameters, in order."""
        own = [getattr(self, spec.name) for spec in parameters_of(type(self))]
        return np.array(own + [value for effect in self.effects for value in effect.values], dtype=float)

    def with_values(self, values: Sequence[float] | Array) -> Self:
        """The same structure with other values (P,).

        Raises:
            BadParameter: a value is out of its bounds, or the number of values is wrong.
        """
        if len(values) != len(self.names):
            raise BadParameter(f"ServoModel has {len(self.names)} parameters, but {len(values)} values were given.")
        other = self.bound([float(value) for value in values])
        return replace(other, effects=tuple(replace(effect) for effect in other.effects))

    def bound(self, values: Any) -> Self:
        """The same structure with expressions (P,) in place of the numbers, without validation: to build equations."""
        other = copy.copy(self)
        specs = parameters_of(type(self))
        for place, spec in enumerate(specs):
            object.__setattr__(other, spec.name, values[place])
        place, effects = len(specs), []
        for effect in self.effects:
            count = len(effect.parameters())
            effects.append(effect.bound([values[place + i] for i in range(count)]))
            place += count
        object.__setattr__(other, "effects", tuple(effects))
        return other

    # The effects.

    def effect(self, name: str) -> Effect | None:
        """The effect of that name, or None."""
        return next((effect for effect in self.effects if effect.name == name), None)

    def with_effect(self, effect: Effect) -> Self:
        """The model with one more effect; it replaces its own kind, its special cases and another drivetrain."""
        gone = {effect.name, *effect.contains}
        kept = (e for e in self.effects if e.name not in gone and not (e.flexible and effect.flexible))
        return replace(self, effects=(*kept, effect))

    def holds(self, name: str) -> bool:
        """Whether the model has an effect of that name, or one with it as a special case."""
        return any(name in (effect.name, *effect.contains) for effect in self.effects)

    def without_effect(self, name: str) -> Self:
        """The model without the effect of that name."""
        return replace(self, effects=tuple(e for e in self.effects if e.name != name))

    def with_payload(self, *, inertia: float, gravity: float) -> Self:
        """The model with a payload on its load [N m s^2/rad, N m]; a motor before the load does not change."""
        whole = self.inertia + inertia
        effects = tuple(effect.loaded(self.inertia, whole) for effect in self.effects)
        return replace(self, inertia=whole, gravity=self.gravity + gravity, effects=effects)

    def without_clock(self, end: float | None = None) -> ServoModel:
        """The model at the end of its log, for use without the log's clock, as in a controller.

        Each effect that depends on the time of the log defines what remains of it. Of those in the catalogue a payload
        change becomes part of inertia and gravity, and friction drift becomes constant friction at its final level. A
        periodic disturbance is left out, as its phase is unknown, and so is a curve over time: it could only be a
        constant torque, which an estimator finds without it.

        Args:
            end: when the log ended, on its clock [s]. If that is not known, friction keeps its level at the log's time
                zero.
        """
        model: ServoModel = self
        for effect in self.effects:
            if effect.clocked:
                model = effect.without_clock(model.without_effect(effect.name), end)
        return model

    def commanded(self) -> ServoModel:
        """The model under a command: without the lag of a measured torque."""
        return replace(self, effects=tuple(effect for effect in self.effects if effect.lead() is None))

    def on_the_load(self) -> ServoModel:
        """The model without effects of the actuator, of a flexible drivetrain and of the sensor."""
        return replace(self, effects=tuple(effect for effect in self.effects if effect.on_the_load()))

    # The mechanics, in numbers or in symbols.

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states: angle, velocity, then those of the effects."""
        names = ["angle", "velocity"]
        for effect in self.effects:
            several = len(effect.states) > 1
            names += [f"{effect.name}.{kind}" if several else effect.name for kind in effect.states]
        return tuple(names)

    @property
    def kinds(self) -> tuple[State, ...]:
        """Kind of each state."""
        return (State.ANGLE, State.VELOCITY, *(kind for effect in self.effects for kind in effect.states))

    def own_states(self, state: Any) -> dict[str, tuple[Any, ...]]:
        """The states (n,) of each effect by its name."""
        own, place = {}, 2
        for effect in self.effects:
            own[effect.name] = tuple(state[place + i] for i in range(len(effect.states)))
            place += len(effect.states)
        return own

    @property
    def drivetrain(self) -> Effect | None:
        """The effect that adds a motor before the load, or None."""
        return next((effect for effect in self.effects if effect.flexible), None)

    def load_inertia(self, at: Moment) -> Expression:
        """Inertia that moves with the load [N m s^2/rad]."""
        motor = self.drivetrain
        own = self.inertia if motor is None else (1.0 - motor.share()) * self.inertia
        return own + sum((effect.added_inertia(at) for effect in self.effects), start=0.0)

    def smooth_acceleration(self, at: Moment, own: Mapping[str, tuple[Any, ...]] | None = None) -> Expression:
        """Acceleration of the load without dry friction [rad/s^2] (eq. 4).

        Args:
            at: the load's motion and the torque at the load.
            own: states of the effects, if they have any.
        """
        import casadi as ca

        held = own or {}
        added = sum((e.load_torque(at, *(held.get(e.name) or (0.0,))[:1]) for e in self.effects), start=0.0)
        passive = self.gravity * ca.cos(at.angle) + self.viscous_friction * at.velocity
        return (at.torque + added - passive) / self.load_inertia(at)

    def dry_friction(self, at: Moment) -> tuple[Expression, Expression] | None:
        """Sum of the dry friction of all effects against forward and backward motion [N m], None if there is none."""
        levels = [level for effect in self.effects if (level := effect.dry_friction(at)) is not None]
        if not levels:
            return None
        return sum(f for f, _ in levels), sum(b for _, b in levels)

    @property
    def slides(self) -> bool:
        """Whether there is dry friction."""
        return self.dry_friction(Moment()) is not None

    @property
    def chaotic(self) -> bool:
        """Whether neighbouring trajectories may diverge."""
        return any(effect.chaotic for effect in self.effects)

    def measurement(self, state: Any) -> Expression:
        """The measurement of the sensor in a state (n,) [rad]."""
        own, shown = self.own_states(state), state[0]
        for effect in self.effects:
            shown = effect.measurement(shown, *(own[effect.name] or (0.0,))[:1])
        return shown

    def delay(self) -> Expression:
        """Dead time of the command [s]."""
        return sum((effect.delay() for effect in self.effects), start=0.0)

    def lead(self) -> Expression | None:
        """Lag of the torque in a log because it was measured [s]; None if it is a command."""
        return next((lead for effect in self.effects if (lead := effect.lead()) is not None), None)

    def inverse(self, angle: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike) -> pd.DataFrame:
        """The torque command for a motion, with each effect's share in a column: see `plant.inverse.inverse`."""
        from plant.inverse import inverse

        return inverse(self, angle, velocity, acceleration)

    def __str__(self) -> str:
        """The parameters with their units."""
        return ", ".join(
            f"{spec.name} = {value:.4g} {printed(spec.unit)}".rstrip()
            for spec, value in zip(self.parameters, self.values, strict=True)
        )

    @property
    def structure(self) -> tuple[Any, ...]:
        """Everything except numbers that determines the equations: equal structures share compiled functions."""
        return (type(self), self.axis, tuple(type(effect) for effect in self.effects))
