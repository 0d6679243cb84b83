"""The servo model linearised at an operating point, for the tools of linear control."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from plant.discrete import INPUTS, Structure, integration_steps, sample_reading, sample_step
from plant.effects import State
from plant.effects.effect import Array, Moment
from plant.errors import BadParameter
from plant.servo import ServoModel
from plant.simulation import at_switch, beginning, whole_samples
from plant.symbolic import one_at_a_time

_ITERATIONS = 50
_SLOW = 1e-3
"""Smoothing of dry friction in the search for rest [rad/s]; it selects the torque that needs no stiction."""
_SHORT = 1e-6
"""Share of Newton's step from which it is short."""
_JUMP = 0.01
"""Largest jump of the velocity where dry friction changes its direction, as a share of the friction."""
_STARTS = (0.0, *(sign * 10.0**k for k in range(-3, 5) for sign in (1, -1)))
"""Torques to begin with [N m]: a dead zone has zero slope inside, a saturation outside."""


def linearise(
    model: ServoModel, *, sample_time: float, angle: float = 0.0, velocity: float = 0.0, width: float = 0.0
) -> Any:
    """The sampled model as a `control.StateSpace`: (change of the held torque) -> (change of the measurement).

        z[k+1] = A z[k] + B u[k],   y[k] = C z[k]

    with the derivatives of `sample_step`. The states are those of the model and, if there is a dead time, the delayed
    torques.

    Args:
        model: the servo.
        sample_time: [s].
        angle, velocity: of the load at the operating point [rad], [rad/s] (on a linear axis [m], [m/s]); a constant
            torque keeps it there, with all other states settled.
        width: velocity up to which dry friction counts as viscous [rad/s]. With 0 a load at rest sticks, and its linear
            model does not move: B is zero, as it is inside a dead zone.

    Raises:
        BadParameter: a sample time that is not positive, or no torque keeps the operating point.
    """
    import control  # slow to import

    torque, state = operating_point(model, sample_time=sample_time, angle=angle, velocity=velocity, width=width)
    model = model.commanded()
    late, switch = whole_samples(float(model.delay()), sample_time)
    values, inputs = at_switch(model, switch), _inputs(torque, sample_time, width)
    _, A, B = (np.array(part) for part in _derivatives(Structure(model), sample_time)(state, inputs, values))
    C = np.array(_sensor(Structure(model))(state, values))
    names = [name.replace(".", "_") for name in model.states]
    n, under_way = len(names), late + 1 if "input_delay.time" in model.names else 0
    whole, entering = np.zeros((n + under_way, n + under_way)), np.zeros((n + under_way, 1))
    whole[:n, :n] = A
    if under_way:  # after the states: u[k-1], ..., u[k-late-1]
        whole[:n, n + late] = B[:, 1]
        entering[n] = 1.0
        whole[n + 1 :, n:-1] = np.eye(late)
    if late:
        whole[:n, n + late - 1] += B[:, 0]
    else:
        entering[:n, 0] = B[:, 0]
    return control.ss(
        whole,
        entering,
        np.hstack((C, np.zeros((1, under_way)))),
        0,
        sample_time,
        states=[*names, *(f"torque_{i}_before" for i in range(1, under_way + 1))],
        inputs=["torque" if model.axis == "rotary" else "force"],
        outputs=["measurement"],
    )


def operating_point(
    model: ServoModel, *, sample_time: float, angle: float = 0.0, velocity: float = 0.0, width: float = 0.0
) -> tuple[float, Array]:
    """The constant torque [N m] that keeps a velocity at an angle, and the state (n,) with everything settled.

    Found by Newton's method on one sample: every state except the load's own is periodic or, if it is an angle, moves
    with the load. Where dry friction changes its direction, the velocity after a sample jumps a little;
    there the step is halved until it is short. Arguments and errors are those of `linearise`.
    """
    if not (np.isfinite(sample_time) and sample_time > 0.0):
        raise BadParameter(f"sample_time must be finite and above zero, not {sample_time:g}.")
    derivatives = _derivatives(Structure(model), sample_time)
    values = at_switch(model, whole_samples(float(model.delay()), sample_time)[1])
    moving = np.array([velocity * sample_time if kind is State.ANGLE else 0.0 for kind in model.kinds])
    levels = model.dry_friction(Moment(angle=angle, inertia=model.inertia)) or (0.0, 0.0)
    friction = max(float(level) for level in levels)
    for torque in _STARTS:
        state = beginning(model, angle=angle, velocity=velocity, torque=torque)
        least, share = np.inf, 1.0
        for _ in range(_ITERATIONS):
            at = _inputs(torque, sample_time, width if velocity else max(width, _SLOW))
            following, A, B = (np.array(part) for part in derivatives(state, at, values))
            off = (following[:, 0] - state - moving)[1:]
            slopes = np.column_stack(((A - np.eye(state.size))[1:, 2:], B[1:].sum(axis=1)))
            if not (np.isfinite(off).all() and np.isfinite(slopes).all()):
                break
            step, size = -np.linalg.lstsq(slopes, off, rcond=None)[0], float(np.max(np.abs(off)))
            share, least = (share if size < least else 0.5 * share), min(size, least)
            state[2:] += share * step[:-1]
            torque += share * float(step[-1])
            at_rest = size < 1e-12 * (1.0 + np.max(np.abs(state)))
            if at_rest or (share < _SHORT and abs(step[-1]) < _JUMP * friction):
                return torque, state
    raise BadParameter(f"No torque keeps the load at {angle:g} with velocity {velocity:g}.")


def _inputs(torque: float, sample_time: float, width: float) -> Array:
    """The inputs of a step, see `INPUTS`."""
    return np.array([torque, torque, 0.0, np.inf, 0.0, sample_time, width, 0.0])


@one_at_a_time
@lru_cache(maxsize=64)
def _derivatives(structure: Structure, sample_time: float) -> Any:
    """(state, inputs, parameters) -> next state, its derivatives by the state (n, n) and by both commands (n, 2)."""
    model = structure.model
    state, inputs = ca.SX.sym("state", len(model.states)), ca.SX.sym("inputs", len(INPUTS))
    parameters = ca.SX.sym("parameters", len(model.names))
    following = sample_step(model, substeps=integration_steps(model, sample_time))(state, inputs, parameters)
    outputs = [following, ca.jacobian(following, state), ca.jacobian(following, inputs[:2])]
    return ca.Function("derivatives", [state, inputs, parameters], [ca.densify(part) for part in outputs])


@one_at_a_time
@lru_cache(maxsize=64)
def _sensor(structure: Structure) -> Any:
    """(state, parameters) -> derivative of the measurement by the state (1, n)."""
    model = structure.model
    state, parameters = ca.SX.sym("state", len(model.states)), ca.SX.sym("parameters", len(model.names))
    shown = sample_reading(model)(state, parameters)
    return ca.Function("sensor", [state, parameters], [ca.densify(ca.jacobian(shown, state))])
