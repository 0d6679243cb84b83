"""One sample ahead: the servo model over a time step, as a CasADi function.

The function is built once for a structure (which effects, which method) and is then mapped over a log or a horizon;
parameters, the time step and the smoothing width are its inputs.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, Literal, TypeAlias

import casadi as ca
import numpy as np

from plant.actuator import actuated, settling_time
from plant.effects import Expression, Moment
from plant.errors import BadParameter
from plant.integrator import Step, advance
from plant.servo import ServoModel
from plant.symbolic import one_at_a_time

Method: TypeAlias = Literal["rk4", "backward_difference"]
_INSTANT = 1e-15  # [s]
_TURN = 0.25  # largest phase of the rigid body's own motion in an integration step [rad]
_ROTATION = 1.0  # largest rotation in an integration step, for torques that repeat with each turn [rad]
_MOST_STEPS = 20  # integration steps per sample that the rigid body may require

INPUTS = ("command", "previous_command", "servo_gain", "command_limit", "time", "dt", "width", "servo_damping")
"""Inputs of a step besides state and parameters.

command:           torque command from now on [N m]; of a position servo: servo gain times set-point
previous_command:  the command before, effective until a dead time within the sample has passed [N m]; of a measured
                   torque these two are the next value and the value at the sample
servo_gain:        decrease of the drive's torque with the angle [N m/rad]; 0 when the log gives the torque
command_limit:     bound on the drive's torque [N m]; inf if there is none
time:              at the start of the sample, on the log's clock [s]
dt:                time step [s]
width:             velocity over which dry friction is smoothed [rad/s]; 0 is the exact form, with stiction
servo_damping:     decrease of the drive's torque with the velocity of the load [N m s/rad]
"""


def sample_step(model: ServoModel, *, substeps: int = 1, settling: int = 3, method: Method = "rk4") -> Any:
    """The step (state, inputs, parameters) -> next state, as a `casadi.Function`.

    Args:
        model: its structure is used, not its numbers.
        substeps: integration steps in one sample, see `integration_steps`.
        settling: least number of integration steps while an actuator settles after a change of the command. With one
            step the mean of its torque is exact; if it settles slowly, the angle has an error of a hundredth of its
            change in a sample.
        method: "rk4" integrates eqs. (4), (6) and the effects by the classical Runge-Kutta method, dry friction by an
            implicit step; "backward_difference" is eq. (5) of the paper, for models without effects that have dry
            friction or states.

    Returns:
        Function of (n,) state [rad, rad/s, effect states], (8,) inputs (see `INPUTS`), (P,) parameters.

    Raises:
        BadParameter: unknown method, or eq. (5) for a model that it cannot express.
    """
    if substeps < 1:
        raise BadParameter(f"substeps must be at least 1, not {substeps}.")
    if method not in ("rk4", "backward_difference"):
        raise BadParameter(f"method must be 'rk4' or 'backward_difference', not {method!r}.")
    if method == "backward_difference" and (len(model.states) > 2 or model.slides):
        raise BadParameter("Equation (5) knows no dry friction and no states of effects; use the method 'rk4'.")
    return _build(Structure(model), substeps, settling, method)


class Structure:
    """A model as the key of a cache: two are equal when their equations are."""

    def __init__(self, model: ServoModel) -> None:
        """Wrap a model; its numbers do not matter."""
        self.model = model

    def __eq__(self, other: object) -> bool:
        """Whether the equations are the same, whatever the numbers."""
        return isinstance(other, Structure) and self.equations == other.equations

    def __hash__(self) -> int:
        """Hash of the equations."""
        return hash(self.equations)

    @property
    def equations(self) -> tuple[Any, ...]:
        """Everything that determines the equations."""
        return self.model.structure


def longest_step(
    model: ServoModel, sample_time: float, *, stiffness: float = 0.0, damping: float = 0.0, speed: float = 0.0
) -> float:
    """Longest integration step that follows the rigid body and every effect in a log of that sample time [s].

    Args:
        model: the servo.
        sample_time: of the log [s].
        stiffness: gain of a position servo that holds the load [N m/rad].
        damping: its gain on the velocity [N m s/rad].
        speed: highest speed of the load in the log [rad/s].
    """
    held = math.sqrt((abs(model.gravity) + stiffness) / model.inertia)
    rate = (model.viscous_friction + damping) / model.inertia + held
    shortest = sample_time / _MOST_STEPS
    turns = speed / _ROTATION if model.axis == "rotary" else 0.0
    rate = max(rate / _TURN, turns)
    rigid = max(1.0 / rate, shortest) if rate > 0.0 else sample_time
    return min(rigid, sample_time, *(effect.step_within(sample_time) for effect in model.effects))


def integration_steps(
    model: ServoModel, sample_time: float, *, stiffness: float = 0.0, damping: float = 0.0, speed: float = 0.0
) -> int:
    """Integration steps in one sample, none longer than `longest_step`."""
    longest = longest_step(model, sample_time, stiffness=stiffness, damping=damping, speed=speed)
    return max(1, int(np.ceil(sample_time / longest * (1.0 - 1e-6))))


@one_at_a_time
def sample_reading(model: ServoModel) -> Any:
    """The measurement of the sensor: Function of (n,) state and (P,) parameters."""
    state, parameters = ca.SX.sym("state", len(model.states)), ca.SX.sym("parameters", len(model.names))
    return ca.Function("sample_reading", [state, parameters], [model.bound(parameters).measurement(state)])


@one_at_a_time
@lru_cache(maxsize=256)
def _build(structure: Structure, substeps: int, settling: int, method: Method) -> Any:
    template = structure.model
    state = ca.SX.sym("state", len(template.states))
    inputs = ca.SX.sym("inputs", len(INPUTS))
    parameters = ca.SX.sym("parameters", len(template.names))
    model = template.bound(parameters)
    _, _, gain, limit, time, _, width, damping = ca.vertsplit(inputs)

    one_step = advance if method == "rk4" else _backward_difference
    end = state
    for held, length in stretches(model, inputs):
        for h in division(model, end, held, inputs, length, substeps, settling):
            step = Step(
                command=held,
                rise=rise(model, inputs),
                gain=gain,
                damping=damping,
                limit=limit,
                time=time,
                length=h,
                width=width,
            )
            end, time, held = one_step(model, end, step), time + h, held + h * rise(model, inputs)
    names = (["state", "inputs", "parameters"], ["next_state"])
    return ca.Function("sample_step", [state, inputs, parameters], [end], *names, {"cse": True})


def stretches(model: ServoModel, inputs: Any) -> list[tuple[Expression, Expression]]:
    """Commands held within a sample, with durations; a dead time splits the sample where the new command arrives."""
    command, previous, dt = inputs[0], inputs[1], inputs[5]
    if model.lead() is not None:
        return [(previous, dt)]
    if not any(effect.name == "input_delay" for effect in model.effects):
        return [(command, dt)]
    late = ca.fmin(model.delay(), dt)
    return [(previous, late), (command, dt - late)]


def rise(model: ServoModel, inputs: Any) -> Expression:
    """Slope of a measured torque over a sample [N m/s]; zero for a command, as it is held."""
    return 0.0 if model.lead() is None else (inputs[0] - inputs[1]) / inputs[5]


def division(
    model: ServoModel,
    state: Any,
    command: Expression,
    inputs: Any,
    length: Expression,
    substeps: int,
    least: int = 3,
) -> list[Expression]:
    """Lengths of the integration steps over an interval of constant command; zero for steps that are not needed.

    No step is longer than the sample over its `substeps`. At `least` so many steps cover the settling of a fast
    actuator after a change of the command.
    """
    gain, dt = inputs[2], inputs[5]

    def needed(span: Expression) -> Expression:
        return ca.ceil(substeps * span / ca.fmax(dt, _INSTANT) * (1.0 - 1e-6))

    settling = settling_time(model, model.own_states(state), command, gain)
    if settling is None or least == 1:
        if substeps == 1 or ca.is_equal(length, dt):
            return [length / substeps] * substeps
        count = ca.fmax(needed(length), 1)
        return [ca.if_else(place < count, length / count, 0) for place in range(substeps)]
    early = ca.fmin(settling, length)
    late = length - early
    first = ca.fmax(needed(early), least) if substeps > least else least
    last = ca.fmax(needed(late), 1) if substeps > 1 else 1
    # There is room for all: two counts rounded up exceed `substeps` by one at most, and `first` may be `least` instead.
    late_ones = [ca.if_else(place < first + last, late / last, 0) for place in range(substeps + least)]
    return [ca.if_else(place < first, early / first, each) for place, each in enumerate(late_ones)]


def _backward_difference(model: ServoModel, state: Any, step: Step) -> Any:
    """Equation (5) of the paper: J x'' and K x' by backward differences, gravity and torque at the new sample.

    The unknown angle is on both sides; Newton's method converges to rounding in a few steps, because alpha T^2 / (J + K
    T) is far below 1. The state's velocity replaces (x[k-1] - x[k-2]) / T.
    """
    before, velocity, h = state[0], state[1], step.length
    torque = actuated(model, {}, step.drive(model, {}, before, velocity), h, velocity)[0].end
    guess = before + h * velocity
    x = ca.SX.sym("x")
    v = (x - before) / h
    at = Moment(angle=x, velocity=v, torque=torque, time=step.time + h)
    balance = (v - velocity) / h - model.smooth_acceleration(at)
    newton = x - balance / ca.jacobian(balance, x)
    for _ in range(4):
        guess = ca.substitute(newton, x, guess)
    return ca.vertcat(guess, (guess - before) / h)
