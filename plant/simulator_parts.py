"""A servo in two parts for rigid-body simulators: their attributes, and the rest for a function."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from plant.effects import CoulombFriction, Effect, GravityOffset, Moment, Stage, State, TorqueSaturation
from plant.effects.actuator_lag import ActuatorLag
from plant.effects.effect import Expression
from plant.errors import BadParameter
from plant.servo import ServoModel
from plant.units import axis_quantities


@dataclass(frozen=True, kw_only=True, eq=False)
class Native:
    """The part of a servo for which rigid-body simulators have attributes.

    On a linear axis forces and masses take the place of torques and inertias.

    Attributes:
        axis: "rotary" or "linear".
        inertia: of the load, and `motor_inertia` of a motor before it, 0 if they are one [kg m^2].
        damping: viscous friction [N m s/rad].
        friction: dry friction, the same in both directions and at any speed [N m].
        gravity, quadrature: torque of gravity, gravity cos x + quadrature sin x [N m].
        limit: of the torque [N m]; None if there is none.
        lag, delay: of the actuator [s].
    """

    axis: str
    inertia: float
    motor_inertia: float
    damping: float
    friction: float
    gravity: float
    quadrature: float
    limit: float | None
    lag: float
    delay: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Beyond:
    """The rest, for a function that is called before each step.

    Attributes:
        effects: the effects in it.
        motor, load: torques to add at the motor and at the load [N m]; without a separate motor, their sum.
        friction: dry friction of this step [N m].
        remembered: names of stored values, and `after` their next values.
        symbols: angle, velocity, torque after the actuator, on a linear axis position, velocity, force; with a motor
            before the load its angle and velocity; then the stored values.
        measurement: of the sensor.
    """

    effects: tuple[Effect, ...]
    motor: Any
    load: Any
    friction: Any
    remembered: tuple[str, ...]
    after: tuple[Any, ...]
    symbols: tuple[Any, ...]
    measurement: Any

    def needs(self, name: str) -> bool:
        """Whether the torques or the friction depend on a symbol of that name."""
        symbol = next((s for s in self.symbols if s.name() == name), None)
        parts = ca.vertcat(self.motor, self.load, self.friction)
        return symbol is not None and bool(ca.depends_on(parts, symbol))


def native_part(model: ServoModel) -> Native:
    """The part of a model without clock for which simulators have attributes.

    Raises:
        BadParameter: a torque that is not in N m, or a force that is not in N.
    """
    if model.torque_unit is not None:
        _, _, torque, unit = axis_quantities(model.axis)
        option = {"A": "--torque-constant", "rad": "--kp", "m": "--kp"}.get(model.torque_unit, f"--scale {torque}=")
        raise BadParameter(
            f"Simulators of rigid bodies need a {torque} in {unit}, but that of the model is in {model.torque_unit}; "
            f"identify the model again with {option}."
        )
    motor, gravity = model.drivetrain, model.effect("gravity_offset")
    coulomb, lag, limit = (model.effect(name) for name in ("coulomb_friction", "actuator_lag", "torque_saturation"))
    share = float(motor.share()) if motor is not None else 0.0
    return Native(
        axis=model.axis,
        inertia=(1.0 - share) * model.inertia,
        motor_inertia=share * model.inertia,
        damping=model.viscous_friction,
        friction=coulomb.torque if isinstance(coulomb, CoulombFriction) else 0.0,
        gravity=model.gravity,
        quadrature=gravity.beta if isinstance(gravity, GravityOffset) else 0.0,
        limit=limit.limit if isinstance(limit, TorqueSaturation) else None,
        lag=lag.time_constant if isinstance(lag, ActuatorLag) else 0.0,
        delay=float(model.delay()),
    )


def beyond(model: ServoModel) -> Beyond:
    """The rest of a model without clock, with numbers or symbols as parameters."""
    native = (CoulombFriction, GravityOffset, TorqueSaturation, ActuatorLag)
    rest = [e for e in model.effects if not isinstance(e, native) and e.name != "input_delay"]
    place, _, strength, _ = axis_quantities(model.axis)
    x, v, torque, motor_angle, motor_velocity = (
        ca.SX.sym(name) for name in (place, "velocity", strength, f"motor_{place}", "motor_velocity")
    )
    sliding = [effect for effect in rest if effect.states == (State.RELAXED,)]
    memory = [ca.SX.sym(name) for name in (f"{place}_before", *(f"{effect.name}_state" for effect in sliding))]
    held = {e.name: e.slide(s, x - memory[0]) for e, s in zip(sliding, memory[1:], strict=True)}
    flexible = model.drivetrain
    leaving: Expression = torque
    for effect in rest:
        if not effect.states and effect.stage is Stage.ACTUATOR:
            leaving = effect.command(leaving, 0.0, v if flexible is None else motor_velocity)
    arriving = leaving
    if flexible is not None:
        arriving = flexible.coupling(motor_angle - x, motor_velocity - v, model.inertia)
    at = Moment(angle=x, velocity=v, torque=arriving, inertia=model.inertia)
    load = ca.SX(sum((e.load_torque(at, held.get(e.name, 0.0)) for e in rest), start=0.0))
    forward, backward = map(ca.SX, model.dry_friction(at) or (0.0, 0.0))
    shown: Expression = x
    for effect in model.effects:
        if not effect.states:
            shown = effect.measurement(shown, 0.0)
    found = Beyond(
        effects=tuple(e for e in rest if e.stage is not Stage.SENSOR and not e.name.endswith("rate_limit")),
        motor=ca.SX(leaving - torque) if flexible is None else ca.SX(leaving - torque - arriving),
        load=load - 0.5 * (forward - backward) + (0.0 if flexible is None else arriving),
        friction=0.5 * (forward + backward),
        remembered=tuple(symbol.name() for symbol in memory) if sliding else (),
        after=(x, *held.values()) if sliding else (),
        symbols=(x, v, torque, *((motor_angle, motor_velocity) if flexible is not None else ()), *memory),
        measurement=ca.SX(shown),
    )
    return found
