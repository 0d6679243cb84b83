"""Simulation of the servo model over a sequence of commands."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from plant.actuator import Course, actuated, played
from plant.discrete import Method, Structure, integration_steps, sample_step
from plant.effects import State
from plant.effects.effect import Array
from plant.effects.setpoint_rate_limit import first_setpoint
from plant.errors import BadParameter
from plant.integrator import Step
from plant.measured_torque import supporting_points
from plant.recursion_cache import recursion
from plant.servo import ServoModel
from plant.symbolic import one_at_a_time


def held_commands(model: ServoModel, command: Array, dt: Array) -> tuple[Array, Array, float]:
    """The two commands within each sample under a dead time, and the part of the dead time within a sample.

    A measured torque is not held: it goes linearly from the second to the first.

    Args:
        model: the servo.
        command: (T,) torque command, each held until the next [N m].
        dt: (T,) time step that follows each sample [s].

    Returns:
        (T,) the command after the switch, (T,) the command before the switch, and the time of the switch [s].
    """
    if model.lead() is not None:
        points = supporting_points(command)
        return np.append(points[1:], points[-1:]), points, 0.0
    whole, switch = whole_samples(float(model.delay()), float(np.median(dt)))
    index = np.arange(command.size)
    return command[np.maximum(index - whole, 0)], command[np.maximum(index - whole - 1, 0)], switch


def whole_samples(delay: float, sample_time: float) -> tuple[int, float]:
    """The number of whole samples in a delay [s], and the rest of it [s]."""
    whole = int(np.floor(delay / sample_time + 1e-9))
    return whole, delay - whole * sample_time


def simulate(
    model: ServoModel,
    *,
    command: Array,
    dt: Array | float,
    state: Array | None = None,
    servo_gain: Array | float = 0.0,
    servo_damping: Array | float = 0.0,
    command_limit: float = np.inf,
    substeps: int | None = None,
    width: float = 0.0,
    method: Method = "rk4",
) -> Array:
    """Free simulation over a sequence of commands.

    Args:
        model: the servo.
        command: (T,) torque command, each held for its time step [N m].
        dt: time steps [s], one or (T,).
        state: (n,) state at the first sample; by default at rest at angle zero, with an internal set-point at the first
            one.
        servo_gain, servo_damping: see `INPUTS`, one or (T,).
        command_limit: see `INPUTS`.
        substeps: integration steps in one sample; by default as many as the effects need, or one for eq. (5).
        width: smoothing of dry friction [rad/s]; 0 is exact.
        method: see `sample_step`.

    Returns:
        (T + 1, n) states, the first one being `state`.

    Raises:
        BadParameter: no command, a command or a state that is not finite, or a time step that is not positive.
    """
    command, steps = _checked(command, dt)
    now, before, switch = held_commands(model, command, steps)
    values = at_switch(model, switch)
    gain = np.broadcast_to(np.asarray(servo_gain, dtype=float), command.shape)
    begin = (
        beginning(model, setpoint=first_setpoint(command, gain)) if state is None else np.asarray(state, dtype=float)
    )
    if begin.shape != (len(model.states),) or not np.isfinite(begin).all():
        raise BadParameter(f"state must be {len(model.states)} finite numbers, one for each state of the model.")
    constant = np.ones_like(steps)
    time = np.concatenate(([0.0], np.cumsum(steps[:-1])))
    damping = np.broadcast_to(np.asarray(servo_damping, dtype=float), command.shape)
    inputs = np.stack((now, before, gain, command_limit * constant, time, steps, width * constant, damping))
    needed = (
        1
        if method == "backward_difference"
        else integration_steps(model, float(steps.max()), stiffness=float(gain.max()), damping=float(damping.max()))
    )
    count = needed if substeps is None else substeps
    step = sample_step(model, substeps=count, method=method)
    states = np.array(_repeated(step, command.size)(begin, inputs, values))
    return np.vstack((begin[None, :], states.T))


def _checked(command: Array, dt: Array | float) -> tuple[Array, Array]:
    """Command and time steps (T,), all finite."""
    commands, steps = np.asarray(command, dtype=float), np.asarray(dt, dtype=float)
    if commands.ndim != 1 or not commands.size or not np.isfinite(commands).all():
        raise BadParameter("command must be a list of finite numbers, one for each sample.")
    if steps.shape not in ((), commands.shape) or not (np.isfinite(steps).all() and np.all(steps > 0.0)):
        raise BadParameter("dt must be a positive number of seconds, or one for each sample.")
    return commands, np.broadcast_to(steps, commands.shape)


@one_at_a_time
def _repeated(step: Any, count: int) -> Any:
    return step.mapaccum(count)


def actuator_torque(
    model: ServoModel,
    command: Array,
    dt: Array,
    *,
    velocity: Array,
    angle: Array,
    servo_gain: Array,
    servo_damping: Array,
    command_limit: float = np.inf,
) -> Array:
    """Torque after the drive's law and the actuator's effects along a known motion, as its mean over each sample.

    Args:
        model: the servo.
        command: (T,) torque command; of a position servo servo gain times set-point [N m].
        dt: (T,) time that each is held [s].
        velocity: (T,) of the load, taken for the motor too [rad/s].
        angle: (T,) of the load [rad].
        servo_gain, servo_damping, command_limit: the drive's law, see `INPUTS`; gain and damping (T,).
    """
    now, before, switch = held_commands(model, command, dt)
    entering = before * np.minimum(switch / dt, 1.0) + now * (1.0 - np.minimum(switch / dt, 1.0))
    if (lead := model.lead()) is not None:
        entering = (now + before) / 2 + float(lead) * (now - before) / dt
    setpoint = first_setpoint(command, servo_gain)
    first = entering[0] - servo_gain[0] * angle[0] - servo_damping[0] * velocity[0]
    first = float(np.clip(first, -command_limit, command_limit))
    begin = beginning(model, torque=first, command=float(entering[0]), setpoint=setpoint)
    rows = np.column_stack((entering, servo_gain, angle, velocity, dt, servo_damping))
    _, (torque,) = _actuator(Structure(model))((begin,), rows, model.values, np.array([command_limit]))
    return torque[:, 0]


@recursion(carried=1)
def _actuator(structure: Structure) -> Any:
    """(state), rows of command, gain, angle, velocity, time step and damping, parameters, limit -> mean torque."""
    template = structure.model
    state, parameters = ca.SX.sym("state", len(template.states)), ca.SX.sym("parameters", len(template.names))
    row, limit = ca.SX.sym("row", 6), ca.SX.sym("limit")
    torque, gain, x, v, h, damping = ca.vertsplit(row)
    model = template.bound(parameters)
    own = model.own_states(state)
    step = Step(command=torque, gain=gain, damping=damping, limit=limit, time=0.0, length=h, width=0.0)
    course, behind = actuated(model, own, step.drive(model, own, x, v), h, v)
    following = {**own, **played(model, own, Course.held(torque), gain, h)[1], **behind}
    kept = [value for effect in model.effects for value in following[effect.name]]
    outputs: list[Any] = [ca.densify(ca.vertcat(state[:2], *kept)), ca.densify(course.mean)]
    return ca.Function("actuator", [state, row, parameters, limit], outputs, {"cse": True})


def beginning(
    model: ServoModel,
    *,
    angle: float = 0.0,
    velocity: float = 0.0,
    torque: float = 0.0,
    command: float | None = None,
    setpoint: float = 0.0,
) -> Array:
    """(n,) state at an angle and a velocity, with all other states settled.

    Args:
        model: the servo.
        angle: of load and motor [rad].
        velocity: of load and motor [rad/s].
        torque: after the drive's law [N m].
        command: before it; the torque by default.
        setpoint: set-point of a position servo [rad].
    """
    values = {
        State.ANGLE: angle,
        State.VELOCITY: velocity,
        State.TORQUE: torque,
        State.COMMAND: torque if command is None else command,
        State.SETPOINT: setpoint,
        State.RELAXED: 0.0,
    }
    return np.array([values[kind] for kind in model.kinds], dtype=float)


def at_switch(model: ServoModel, switch: float) -> Array:
    """(P,) parameter values with the dead time reduced to its part within a sample."""
    values = model.values
    if "input_delay.time" in model.names:
        values[model.names.index("input_delay.time")] = switch
    return values
