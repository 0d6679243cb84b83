"""A servo as a Modelica class that needs no library: parameters with units, and the equations of every effect.

Stiction in Modelica would need a state machine with events; here dry friction rises smoothly over a small velocity,
`friction_width`, which is a parameter.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from plant.code_dialects import modelica
from plant.code_text import Symbolic, text_of
from plant.effects import Effect, Moment, Stage, State
from plant.effects.actuator_lag import ActuatorLag
from plant.errors import BadParameter
from plant.inverse import moving, strength, torque_unit
from plant.servo import ServoModel
from plant.symbolic import one_at_a_time

_WIDTH = 1e-3  # velocity over which dry friction rises [rad/s]
_ONCE = 1e-300  # travel for the one-sided rates of a sliding state


@dataclass(frozen=True, kw_only=True)
class ModelicaClass:
    """A class in Modelica: its text, and its omissions, a sentence each."""

    text: str
    left_out: tuple[str, ...]


@one_at_a_time
def modelica_class(model: ServoModel, *, name: str = "Antidrive") -> ModelicaClass:
    """The model as a class with one input, the torque (on a linear axis the force), and the measurement as output.

    Args:
        model: the servo.
        name: of the class.

    Raises:
        BadParameter: a name that is no identifier.
    """
    if not re.fullmatch(r"[A-Za-z]\w*", name):
        raise BadParameter(f"name {name!r}: write letters, digits and underscores, beginning with a letter.")
    timeless = model.without_clock()
    kept = {effect.name for effect in timeless.effects}
    others = [e.title for e in timeless.effects if e.states and not _is_written(e)]
    clocked = [effect.title for effect in model.effects if effect.name not in kept]
    left_out = [f"Not in it: {', '.join(others)}."] if others else []
    if clocked:
        left_out.append(f"Left out, because it holds for the log alone: {', '.join(clocked)}.")
    return ModelicaClass(text=_text(timeless, name, left_out), left_out=tuple(left_out))


def _is_written(effect: Effect) -> bool:
    return effect.flexible or isinstance(effect, ActuatorLag) or effect.states == (State.RELAXED,)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Equations:
    """Names of the states, right sides of all equations, and their symbols."""

    states: list[str]
    right: dict[str, Any]
    symbols: list[Any]


def _text(model: ServoModel, name: str, notes: Iterable[str]) -> str:
    units, entering = moving(model), strength(model)
    place = next(iter(units))
    own = Symbolic.of(model)
    parameters = [
        f'  parameter Real {given}(unit="{_unit(spec.unit)}") = {value!r} "{spec.meaning}";'
        for given, spec, value in own.parameters
    ]
    found = _equations(model.bound(own.values), place)
    text = text_of(found.right, [*found.symbols, *own.symbols], modelica())
    late = f"delay({entering}, input_delay_time)" if model.effect("input_delay") else entering
    width = f'parameter Real friction_width(unit="{_unit(units["velocity"])}") = {_WIDTH!r}'
    return "\n".join(
        [
            f'class {name} "Servo: {", ".join(("rigid body", *(e.title for e in model.effects)))}"',
            *(f"  // {note}" for note in notes),
            *parameters,
            f'  {width} "velocity over which dry friction rises";',
            f'  input Real {entering}(unit="{_unit(torque_unit(model))}") "command";',
            f'  output Real measurement(unit="{_unit(units[place])}") "what the sensor shows";',
            *(f"  Real {state}(start = 0.0, fixed = true);" for state in found.states),
            "  Real entering;",
            "  Real leaving;",
            *(f"  {'Boolean' if w.condition else 'Real'} {w.name};" for w in text.between),
            "equation",
            f"  entering = {late};",
            *(f"  {w.name} = {w.text};" for w in text.between),
            *(f"  {left} = {right};" for left, right in text.results.items()),
            f"end {name};",
            "",
        ]
    )


def _equations(servo: ServoModel, place: str) -> _Equations:
    names = (place, "velocity", "entering", "leaving", "friction_width", f"motor_{place}", "motor_velocity", "lagged")
    x, v, entering, leaving, width, motor, motor_velocity, lagged = symbols = [ca.SX.sym(name) for name in names]
    flexible, lag = servo.drivetrain, servo.effect("actuator_lag")
    sliding = {e: ca.SX.sym(f"{e.name}_state") for e in servo.effects if e.states == (State.RELAXED,)}
    behind = entering if lag is None else lagged
    for effect in servo.effects:
        if not effect.states and effect.stage is Stage.ACTUATOR:
            behind = effect.command(behind, 0.0, v if flexible is None else motor_velocity)
    arriving = leaving
    if flexible is not None:
        arriving = flexible.coupling(motor - x, motor_velocity - v, servo.inertia)
    at = Moment(angle=x, velocity=v, torque=arriving, inertia=servo.inertia)
    acceleration = servo.smooth_acceleration(at, {effect.name: (state,) for effect, state in sliding.items()})
    if (levels := servo.dry_friction(at)) is not None:
        way = ca.tanh(v / width)
        dry = ca.fmax(way, 0) * levels[0] + ca.fmin(way, 0) * levels[1]
        acceleration -= dry / servo.load_inertia(at)
    shown: Any = x
    for effect in servo.effects:
        shown = shown if effect.states else effect.measurement(shown, 0.0)
    right = {"leaving": behind, f"der({place})": v, "der(velocity)": acceleration, "measurement": shown}
    states = [place, "velocity"]
    if flexible is not None:
        right[f"der(motor_{place})"] = motor_velocity
        right["der(motor_velocity)"] = (leaving - arriving) / (flexible.share() * servo.inertia)
        states += [f"motor_{place}", "motor_velocity"]
    if isinstance(lag, ActuatorLag):
        right["der(lagged)"] = (entering - lagged) / lag.time_constant
        states.append("lagged")
    travel = ca.SX.sym("travel")
    for effect, state in sliding.items():
        rate = ca.jacobian(effect.slide(state, travel), travel)
        forward, backward = (ca.substitute(rate, travel, step) for step in (_ONCE, -_ONCE))
        right[f"der({effect.name}_state)"] = ca.if_else(v > 0, forward, backward) * v
        states.append(state.name())
    return _Equations(
        states=states,
        right={left: ca.SX(value) for left, value in right.items()},
        symbols=[*symbols, *sliding.values()],
    )


def _unit(unit: str) -> str:
    """A unit in Modelica syntax: "N.m.s2/rad"."""
    return "1" if unit in ("-", "rad/rad") else unit.replace("^", "").replace(" ", ".")
