"""One sample ahead: the servo model integrated over a time step, as a CasADi function.

The function is built once for a structure (which effects, which method) and is then mapped over a log or a horizon;
parameters, the time step and the smoothing width are its inputs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, TypeAlias

import casadi as ca
import numpy as np

from plant.effects.effect import Array, Expression
from plant.errors import BadParameter
from plant.servo import ServoModel

Method: TypeAlias = Literal["rk4", "backward_difference"]

INPUTS = ("command", "previous_command", "servo_gain", "command_limit", "dt", "width")
"""What a step takes besides state and parameters.

command:           torque command from now on [N m]; of a position servo: servo gain times goal
previous_command:  the command before, which acts until a delay inside the sample has passed [N m]
servo_gain:        by how much the drive's torque falls with the angle [N m/rad]; 0 when the log gives the torque
command_limit:     bound on the drive's torque [N m]; inf if there is none
dt:                time step [s]
width:             velocity over which dry friction is smoothed [rad/s]; 0 is the exact form, in which stiction holds
"""


def sample_step(model: ServoModel, *, substeps: int = 1, method: Method = "rk4") -> Any:
    """The step (state, inputs, parameters) -> next state, as a `casadi.Function`.

    Args:
        model: its structure is used, not its numbers.
        substeps: integration steps in one sample.
        method: "rk4" integrates eqs. (4), (6) and the effects by the classical Runge-Kutta method, dry friction by
            an implicit step; "backward_difference" is eq. (5) of the paper, for models without effects that carry
            dry friction or state.

    Returns:
        Function of (n,) state [rad, rad/s, effect states], (6,) inputs (see `INPUTS`), (P,) parameters.

    Raises:
        BadParameter: unknown method, or eq. (5) asked for a model that it cannot express.
    """
    if substeps < 1:
        raise BadParameter(f"substeps must be at least 1, not {substeps}.")
    if method not in ("rk4", "backward_difference"):
        raise BadParameter(f"method must be 'rk4' or 'backward_difference', not {method!r}.")
    if method == "backward_difference" and (len(model.states) > 2 or model.dry_friction(0.0) is not None):
        raise BadParameter("Equation (5) knows no dry friction and no actuator states; use the method 'rk4'.")
    return _build(_Structure(model), substeps, method)


class _Structure:
    """A model seen as the key of a cache: equal when the equations are."""

    def __init__(self, model: ServoModel) -> None:
        self.model = model

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Structure) and self.model.structure == other.model.structure

    def __hash__(self) -> int:
        return hash(self.model.structure)


@lru_cache(maxsize=256)
def _build(structure: _Structure, substeps: int, method: Method) -> Any:
    template = structure.model
    state = ca.SX.sym("state", len(template.states))
    inputs = ca.SX.sym("inputs", len(INPUTS))
    parameters = ca.SX.sym("parameters", len(template.names))
    model = template.bound(parameters)
    command, previous, gain, limit, dt, width = ca.vertsplit(inputs)

    advance = _runge_kutta if method == "rk4" else _backward_difference
    has_delay = any(effect.name == "input_delay" for effect in model.effects)
    # A delay inside the sample splits it at the instant at which the new command arrives.
    late = ca.fmin(model.delay(), dt)
    stretches = [(previous, late), (command, dt - late)] if has_delay else [(command, dt)]
    end = state
    for torque, length in stretches:
        for h in _steps(model, length, substeps):
            end = advance(model, end, _Drive(torque, gain, limit), h, width)
    names = (["state", "inputs", "parameters"], ["next_state"])
    return ca.Function("sample_step", [state, inputs, parameters], [end], *names, {"cse": True})


def _steps(model: ServoModel, length: Expression, substeps: int) -> list[Expression]:
    """Integration steps over a stretch of constant command: finer while a fast actuator settles behind its change."""
    settling = [effect.settling_time() for effect in model.effects if effect.has_state]
    if not settling:
        return [length / substeps] * substeps
    early = ca.fmin(sum(settling), length)
    count = max(3, substeps)
    return [early / count] * count + [(length - early) / substeps] * substeps


@dataclass(frozen=True)
class _Drive:
    """The drive's law over a step: a held command, less what a position servo takes back with the angle."""

    command: Expression
    gain: Expression
    limit: Expression

    def torque(self, angle: Expression) -> Expression:
        return ca.fmax(ca.fmin(self.command - self.gain * angle, self.limit), -self.limit)


def _actuator(
    model: ServoModel, state: Expression, torque: Expression, h: Expression, *, middle: bool = False
) -> tuple[Expression, list[Any]]:
    """Torque behind the actuator and the states of its effects, `h` after the drive's torque was set.

    In the middle of a step of length `h` an effect with a state gives the value by which Simpson's rule, and so the
    Runge-Kutta method, gets its mean over the step right also when it settles much faster than the step.
    """
    states, place = [], 2
    for effect in model.effects:
        own = 0.0
        if effect.has_state:
            before, own = state[place], effect.advance(state[place], torque, h)
            states.append(own)
            if middle:
                own = (6 * effect.mean(before, torque, h) - before - own) / 4
            place += 1
        torque = effect.command(torque, own)
    return torque, states


def _runge_kutta(model: ServoModel, state: Any, drive: _Drive, h: Expression, width: Expression) -> Any:
    """Classical Runge-Kutta step; dry friction opposes the motion at its start and is put right after a reversal."""
    x, v = state[0], state[1]
    slides = model.dry_friction(v) is not None

    def acceleration(angle: Any, velocity: Any, torque: Any) -> Any:
        smooth = model.smooth_acceleration(angle, velocity, torque)
        return smooth - _friction(model, velocity, v) if slides else smooth

    def torque(angle: Any, **when: Any) -> Any:
        return _actuator(model, state, drive.torque(angle), **when)[0]

    x2 = x + h / 2 * v
    a1 = acceleration(x, v, torque(x, h=0.0))
    v2 = v + h / 2 * a1
    a2 = acceleration(x2, v2, torque(x2, h=h, middle=True))
    v3 = v + h / 2 * a2
    x3 = x + h / 2 * v2
    a3 = acceleration(x3, v3, torque(x3, h=h, middle=True))
    v4 = v + h * a3
    x4 = x + h * v3
    a4 = acceleration(x4, v4, torque(x4, h=h))
    states = _actuator(model, state, drive.torque(x2), h)[1]
    angle = x + h / 6 * (v + 2 * v2 + 2 * v3 + v4)
    velocity = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    if slides:
        angle, velocity = _stop_and_go(model, x, v, angle, velocity, h, width)
    return ca.vertcat(angle, velocity, *states)


def _friction(model: ServoModel, velocity: Any, direction: Any) -> Any:
    """Deceleration by dry friction for motion in a direction, zero at rest [rad/s^2]."""
    forward, backward = (level / model.inertia for level in model.dry_friction(velocity) or (0.0, 0.0))
    return ca.if_else(direction > 0, forward, 0) - ca.if_else(direction < 0, backward, 0)


def _stop_and_go(
    model: ServoModel, x: Any, v: Any, angle: Any, velocity: Any, h: Expression, width: Expression
) -> tuple[Any, Any]:
    """Correct a step from (x, v) to (angle, velocity), taken with the friction of its start, for a stop inside it.

    Exact form (width 0): the load slides until it stops; from there on it holds, or slides on if the torque is above
    breakaway. Nothing chatters at any step length, stiction holds to rounding, and the instant of the reversal is
    found inside the step.

    Smooth form: friction rises linearly with velocity up to `width`, as an implicit step in closed form (Moreau 1988
    for width 0), so that a fit sees a slope also where the load sticks.
    """
    between = (v + velocity) / 2
    forward, backward = (level / model.inertia for level in model.dry_friction(between) or (0.0, 0.0))
    slowing = _friction(model, between, v)
    pull = (velocity - v) / ca.fmax(h, 1e-15) + slowing  # mean acceleration without dry friction

    free = v + pull * h
    most = h * ca.if_else(free > 0, forward, backward)
    reach = width + most + 1e-15  # so that no friction at all has a derivative too
    taken = most * ca.fmax(ca.fmin(free / reach, 1), -1)
    smooth = (angle + slowing * h**2 / 2 - h / 2 * taken, free - taken)

    same_way = v * velocity > 0
    to_rest = ca.fmin(h * v / ca.if_else(same_way, ca.sign(v) * 1e15, v - velocity + 1e-300), h)
    again = ca.fmax(pull - forward, 0) + ca.fmin(pull + backward, 0)
    stopped = (x + v * to_rest / 2 + again * (h - to_rest) ** 2 / 2, again * (h - to_rest))
    exact = [ca.if_else(same_way, a, b) for a, b in zip((angle, velocity), stopped, strict=True)]
    angles, velocities = zip(smooth, exact, strict=True)
    return ca.if_else(width > 0, *angles), ca.if_else(width > 0, *velocities)


def _backward_difference(model: ServoModel, state: Any, drive: _Drive, h: Expression, width: Expression) -> Any:
    """Equation (5) of the paper: J x'' and K x' by backward differences, gravity and torque at the new sample.

    The angle to find stands on both sides; Newton's method on it converges to rounding in a few steps, because
    alpha T^2 / (J + K T) is far below 1. The state's velocity stands for (x[k-1] - x[k-2]) / T.
    """
    before, velocity = state[0], state[1]
    torque, _ = _actuator(model, state, drive.torque(before), h)
    guess = before + h * velocity
    x = ca.SX.sym("x")
    v = (x - before) / h
    balance = (v - velocity) / h - model.smooth_acceleration(x, v, torque)
    newton = x - balance / ca.jacobian(balance, x)
    for _ in range(4):
        guess = ca.substitute(newton, x, guess)
    return ca.vertcat(guess, (guess - before) / h)


def held_commands(command: Array, dt: Array, delay: float) -> tuple[Array, Array, float]:
    """The two commands that act within each sample under a delay, and the part of the delay inside a sample.

    Args:
        command: (T,) torque command, each held until the next [N m].
        dt: (T,) time step that follows each sample [s].
        delay: dead time [s].

    Returns:
        (T,) the command from the switch on, (T,) the command until the switch, and when the switch comes [s].
    """
    step = float(np.median(dt))
    whole = int(np.floor(delay / step + 1e-9))
    index = np.arange(command.size)
    return command[np.maximum(index - whole, 0)], command[np.maximum(index - whole - 1, 0)], delay - whole * step


def simulate(
    model: ServoModel,
    *,
    command: Array,
    dt: Array | float,
    state: Array | None = None,
    servo_gain: Array | float = 0.0,
    command_limit: float = np.inf,
    substeps: int = 1,
    width: float = 0.0,
    method: Method = "rk4",
) -> Array:
    """Free simulation over a sequence of commands.

    Args:
        model: the servo.
        command: (T,) torque command, each held for its time step [N m].
        dt: time steps [s], one or (T,).
        state: (n,) state at the first sample; at rest at angle zero by default.
        servo_gain: see `INPUTS`, one or (T,).
        command_limit: see `INPUTS`.
        substeps: integration steps in one sample.
        width: smoothing of dry friction [rad/s]; 0 is exact.
        method: see `sample_step`.

    Returns:
        (T + 1, n) states, the first one being `state`.
    """
    command = np.asarray(command, dtype=float)
    steps = np.broadcast_to(np.asarray(dt, dtype=float), command.shape)
    begin = rest(model) if state is None else np.asarray(state, dtype=float)
    now, before, switch = held_commands(command, steps, float(model.delay()))
    values = at_switch(model, switch)
    gain = np.broadcast_to(np.asarray(servo_gain, dtype=float), command.shape)
    constant = np.ones_like(steps)
    inputs = np.stack((now, before, gain, command_limit * constant, steps, width * constant))
    step = sample_step(model, substeps=substeps, method=method)
    states = np.array(step.mapaccum(command.size)(begin, inputs, values))
    return np.vstack((begin[None, :], states.T))


def actuator_torque(model: ServoModel, command: Array, dt: Array) -> Array:
    """(T,) torque behind the actuator's effects, mean over each sample [N m], of a command (T,) held for steps (T,)."""
    now, before, switch = held_commands(command, dt, float(model.delay()))
    entering = before * np.minimum(switch / dt, 1.0) + now * (1.0 - np.minimum(switch / dt, 1.0))
    if len(model.states) == 2:
        return np.array(_actuator(model, None, ca.DM(entering), 0.0)[0]).ravel()
    state, torque, h = ca.SX.sym("state", len(model.states)), ca.SX.sym("torque"), ca.SX.sym("h")
    start, middle, (end, states) = (
        _actuator(model, state, torque, 0.0)[0],
        _actuator(model, state, torque, h, middle=True)[0],
        _actuator(model, state, torque, h),
    )
    one = ca.Function("actuator", [state, torque, h], [ca.vertcat(state[:2], *states), (start + 4 * middle + end) / 6])
    begin = rest(model, torque=float(entering[0]))
    return np.array(one.mapaccum(command.size)(begin, entering[None, :], dt[None, :])[1]).ravel()


def rest(model: ServoModel, angle: float = 0.0, torque: float = 0.0) -> Array:
    """(n,) state at rest at an angle, with actuator states settled at a torque."""
    return np.array([angle, 0.0] + [torque] * (len(model.states) - 2))


def at_switch(model: ServoModel, switch: float) -> Array:
    """(P,) parameter values with the delay reduced to its part inside a sample."""
    values = model.values
    if "input_delay.time" in model.names:
        values[model.names.index("input_delay.time")] = switch
    return values
