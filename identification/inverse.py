"""The inverse model: the torque that the measured motion needs, beside the torque that was commanded.

Derivatives of the measured angle come from a zero-phase Butterworth filter and central differences, and every signal
passes the same filter (Gautier 1997; the practice of robot identification). It gives a start for the fit, because
J, alpha and K are linear in it, and the relative torque error in which inverse models are published.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy import optimize, signal

from identification.log import Log, Run
from plant.effects import DeadZone, Moment, State
from plant.effects.effect import Array
from plant.servo import ServoModel
from plant.simulation import actuator_torque


@dataclass(frozen=True, kw_only=True, eq=False)
class FilteredMotion:
    """A run's motion and torque behind the same low pass, on a uniform time grid.

    Attributes:
        time, angle, velocity, acceleration, torque: (T,) [s, rad, rad/s, rad/s^2, N m]; a linear axis has m and N.
    """

    time: Array
    angle: Array
    velocity: Array
    acceleration: Array
    torque: Array


def filtered_motion(run: Run, cutoff: float, model: ServoModel | None = None) -> FilteredMotion:
    """Filter a run with a zero-phase 4th-order Butterworth low pass at `cutoff` [Hz].

    The torque is the command or, when a model is given, what arrives behind its actuator effects.
    """
    good = run.valid
    time = np.linspace(run.time[0], run.time[-1], len(run))
    dt = float(time[1] - time[0])
    output = np.interp(time, run.time[good], run.output[good])
    low_pass = signal.butter(4, min(cutoff, 0.45 / dt), fs=1.0 / dt, output="sos")

    def smooth(values: Array) -> Array:
        return np.asarray(signal.sosfiltfilt(low_pass, values), dtype=float)

    angle = smooth(output if model is None else _true_angle(model, output))
    velocity = np.gradient(angle, dt)
    drive = np.clip(run.command - run.servo_gain * run.output, -run.command_limit, run.command_limit)
    if model is not None:
        drive = actuator_torque(
            model,
            run.command,
            np.append(np.diff(run.time), dt),
            velocity=velocity,
            angle=run.output,
            servo_gain=run.servo_gain,
            command_limit=run.command_limit,
        )
    # A command is held for the sample that follows; at a sampling instant half of the old and half of the new one act.
    impulse = np.concatenate(([0.0], np.cumsum(drive[:-1] * np.diff(run.time))))
    edges = np.clip(np.stack((time - dt / 2, time + dt / 2)), run.time[0], run.time[-1])
    torque = np.diff(np.interp(edges, run.time, impulse), axis=0)[0] / np.diff(edges, axis=0)[0]
    return FilteredMotion(
        time=time,
        angle=angle,
        velocity=velocity,
        acceleration=np.gradient(velocity, dt),
        torque=smooth(torque),
    )


def starting_values(log: Log, model: ServoModel, cutoff: float) -> Array | None:
    """(P,) values with J, alpha and K from linear regression on the filtered torque balance, effects as they are.

    A dead zone is not linear and a fit that starts from none can stay there; so the regression is done for several half
    widths and the best is kept (variable projection). None if there is nothing to stand on (no motion).
    """
    found = [_regression(log, variant, cutoff) for variant in _with_dead_zones(log, model)]
    usable = [pair for pair in found if pair is not None]
    return min(usable, key=lambda pair: pair[0])[1] if usable else None


def _with_dead_zones(log: Log, model: ServoModel) -> list[ServoModel]:
    if model.effect("dead_zone") is None:
        return [model]
    largest = max(float(np.max(np.abs(run.command))) for run in log.runs)
    return [model.with_effect(DeadZone(half_width=share * largest)) for share in (0.0, 0.02, 0.05, 0.1, 0.2, 0.4)]


def _regression(log: Log, model: ServoModel, cutoff: float) -> tuple[float, Array] | None:
    """Sum of squares that the regression leaves, and the values (P,)."""
    rows = []
    for run in log.runs:
        m = filtered_motion(run, cutoff, model)
        gravity = np.cos(m.angle) if model.axis == "rotary" else np.zeros_like(m.angle)
        edge = min(m.time.size // 10, 100)
        rows.append(np.column_stack((m.acceleration, gravity, m.velocity, m.torque))[edge : m.time.size - edge])
    table = np.vstack(rows)
    regressors, torque = table[:, :3], table[:, 3]
    scale = np.sqrt(np.mean(regressors**2, axis=0))
    if scale[0] <= 0.0 or scale[2] <= 0.0:
        return None
    scale[1] = scale[1] or 1.0
    solution = optimize.lsq_linear(regressors / scale, torque, bounds=([1e-9, -np.inf, 0.0], np.inf))
    values = model.values
    values[:3] = np.maximum(solution.x / scale, [spec.lower for spec in model.parameters[:3]])
    return float(solution.cost), values


def torque_error(log: Log, model: ServoModel, *, cutoff: float) -> float:
    """Relative error of the inverse model over a log: |torque - needed torque| / |torque| [-].

    Args:
        log: measured motion and torque.
        model: its dry friction acts by the direction of the filtered velocity.
        cutoff: of the filter [Hz]; figures compare only at the same one.
    """
    misses, torques = [], []
    for run in log.runs:
        m = filtered_motion(run, cutoff, model)
        edge = min(m.time.size // 10, int(2.0 / (cutoff * run.sample_time)))
        inner = slice(edge, m.time.size - edge)
        misses.append((m.torque - needed_torque(model, m))[inner])
        torques.append(m.torque[inner])
    return float(np.linalg.norm(np.concatenate(misses)) / np.linalg.norm(np.concatenate(torques)))


def needed_torque(model: ServoModel, motion: FilteredMotion) -> Array:
    """(T,) torque behind the actuator that the motion needs [N m]: eq. (4) solved for it, the drivetrain rigid."""
    x, v, t, torque, travel = (ca.SX.sym(name) for name in ("x", "v", "t", "torque", "travel"))
    dt = float(motion.time[1] - motion.time[0])
    state = ca.SX.sym("state", len(model.states))
    own = model.own_states(state)
    at = Moment(angle=x, velocity=v, torque=torque, time=t, travel=travel, step=dt)
    still = Moment(angle=x, velocity=v, torque=0.0, time=t, travel=travel, step=dt)
    free = -model.load_inertia(still) * model.smooth_acceleration(still, own)
    levels = model.dry_friction(at)
    if levels is not None:
        free += ca.if_else(v > 0, levels[0], -levels[1]) * ca.fabs(ca.sign(v))
    inertia = model.inertia + sum((effect.added_inertia(still) for effect in model.effects), start=0.0)
    slid = [
        effect.slide(own[effect.name][i], travel) if kind is State.RELAXED else own[effect.name][i]
        for effect in model.effects
        for i, kind in enumerate(effect.states)
    ]
    passive = ca.Function("passive", [state, x, v, t, torque, travel], [ca.vertcat(x, v, *slid), free, inertia])
    travels = np.diff(motion.angle, prepend=motion.angle[0])
    rows = (motion.angle, motion.velocity, motion.time, motion.torque, travels)
    begin = np.zeros(len(model.states))
    _, torques, inertias = passive.mapaccum(motion.time.size)(begin, *(row[None, :] for row in rows))
    return np.array(inertias).ravel() * motion.acceleration + np.array(torques).ravel()


def _true_angle(model: ServoModel, reading: Array) -> Array:
    """(T,) angle that a sensor of small error shows as a reading (T,), the sensor's lag aside."""
    shown = reading
    for effect in model.effects:
        if not effect.states:
            shown = np.array(effect.reading(ca.DM(shown), 0.0)).ravel()
    return np.asarray(reading - (shown - reading))
