"""The inverse model: the torque needed for the measured motion, compared with the commanded torque.

The derivatives of the measured angle come from a zero-phase Butterworth filter and central differences; every signal
passes the same filter (Gautier 1997; common practice in robot identification). The result is the relative torque error,
the usual measure in publications on inverse models.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identification.log import Log, Run
from identification.run_parameters import own_model
from plant.discrete import Structure
from plant.effects import Effect, Moment, State
from plant.effects.effect import Array
from plant.recursion_cache import recursion
from plant.servo import ServoModel
from plant.simulation import actuator_torque

_PERIODS = 5.0  # of the lowest cutoff frequency in the longest run


@dataclass(frozen=True, kw_only=True, eq=False)
class FilteredMotion:
    """A run's motion and torque after the same low pass, on a uniform time grid.

    Attributes:
        time, angle, velocity, acceleration, torque: (T,) [s, rad, rad/s, rad/s^2, N m]; a linear axis has m and N.
        still: (T,) whether the load rests, as far as the encoder shows.
    """

    time: Array
    angle: Array
    velocity: Array
    acceleration: Array
    torque: Array
    still: NDArray[np.bool_]


def inverse_cutoff(log: Log) -> float:
    """Cutoff of the low pass behind which inverse models are compared on a log [Hz]."""
    return min(40.0, 0.1 / log.runs[0].sample_time)


def lowest_cutoff(log: Log) -> float:
    """Lowest cutoff of a low pass [Hz]: a few of its periods fit into the longest run."""
    return _PERIODS / max(run.duration for run in log.runs)


def filtered_motion(run: Run, cutoff: float, model: ServoModel | None = None) -> FilteredMotion:
    """Filter a run with a zero-phase 4th-order Butterworth low pass at `cutoff` [Hz].

    The torque is the command or, when a model is given, the torque after its actuator effects.
    """
    if run.response == "torque":  # it is filtered
        return FilteredMotion(
            time=run.time,
            angle=run.output,
            velocity=_given(run.velocity),
            acceleration=_given(run.acceleration),
            torque=run.command,
            still=~run.valid,
        )
    time = np.linspace(run.time[0], run.time[-1], len(run))
    dt = float(time[1] - time[0])
    output = np.interp(time, run.time[run.valid], run.output[run.valid])
    shown = output if model is None else _true_angle(model, output)
    angle = smooth(shown, cutoff, dt)
    velocity = np.gradient(angle, dt)
    return FilteredMotion(
        time=time,
        angle=angle,
        velocity=velocity,
        acceleration=np.gradient(velocity, dt),
        torque=smooth(mean_torque(run, model, velocity), cutoff, dt),
        still=np.abs(velocity) <= max(_count(run) * cutoff, 3.0 * _speed_noise(shown - angle, cutoff, dt)),
    )


def _given(column: Array | None) -> Array:
    return np.empty(0) if column is None else column


def _speed_noise(noise: Array, cutoff: float, dt: float) -> float:
    """Standard deviation of the filtered velocity of a load at rest [rad/s or m/s].

    From what the low pass has removed (T,), a sample of the encoder's white noise: its median, as parts of it may be
    motion. A velocity has the noise of the angle times 2 pi f, here over all frequencies f below the cutoff.
    """
    angle = float(np.median(np.abs(noise))) / 0.6745  # median of a Gaussian
    return float(2.0 * np.pi * cutoff * angle * np.sqrt(2.0 * dt * cutoff / 3.0))


def _count(run: Run) -> float:
    """Smallest step of the measurement [rad or m]: an encoder count, unless the values are not quantised."""
    steps = np.abs(np.diff(run.output[run.valid]))
    return float(np.min(steps, where=steps > 0.0, initial=np.max(steps, initial=0.0)))


def smooth(values: Array, cutoff: float, dt: float) -> Array:
    """(T,) values after the zero-phase low pass; cutoff [Hz], dt [s]."""
    from scipy import signal

    low_pass = _low_pass(cutoff, dt)
    padding = min(3 * (2 * len(low_pass) + 1), len(values) - 1)  # SciPy's default, if the record is long enough
    return np.asarray(signal.sosfiltfilt(low_pass, values, padlen=padding), dtype=float)


@lru_cache(maxsize=64)
def _low_pass(cutoff: float, dt: float) -> Array:
    """Second-order sections of the low pass; cached, as the design takes as long as filtering thousands of samples."""
    from scipy import signal

    return np.asarray(signal.butter(4, min(cutoff, 0.45 / dt), fs=1.0 / dt, output="sos"))


def mean_torque(run: Run, model: ServoModel | None, velocity: Array) -> Array:
    """(T,) mean torque over one sample time around each of T evenly spaced instants.

    A command is held until the next sample; so the mean around a sampling instant is half the old, half the new
    command.
    """
    time = np.linspace(run.time[0], run.time[-1], len(run))
    dt, steps = float(time[1] - time[0]), np.diff(run.time)
    drive = np.clip(run.drive, -run.command_limit, run.command_limit)
    if model is not None:
        drive = actuator_torque(
            model,
            run.command,
            np.append(steps, dt),
            velocity=velocity,
            angle=run.output,
            servo_gain=run.servo_gain,
            servo_damping=run.servo_damping,
            command_limit=run.command_limit,
        )
    impulse = np.concatenate(([0.0], np.cumsum(drive[:-1] * steps)))
    edges = np.clip(np.stack((time - dt / 2, time + dt / 2)), run.time[0], run.time[-1])
    return np.asarray(np.diff(np.interp(edges, run.time, impulse), axis=0)[0] / np.diff(edges, axis=0)[0])


def torque_error(log: Log, model: ServoModel, *, cutoff: float) -> float:
    """Relative error of the inverse model over a log: |torque - needed torque| / |torque| [-].

    Args:
        log: measured motion and torque.
        model: the direction of its dry friction is that of the filtered velocity.
        cutoff: of the filter [Hz]; only errors with the same cutoff can be compared.
    """
    missed, torque = torque_error_samples(log, model, cutoff=cutoff)
    return float(np.linalg.norm(missed) / np.linalg.norm(torque))


def torque_error_samples(log: Log, model: ServoModel, *, cutoff: float) -> tuple[Array, Array]:
    """(T,) torque less needed torque, and (T,) torque of the log [N m], of all runs; arguments as in `torque_error`.

    The first torque is that after the model's actuator. The second is not: a large offset in the model, which gravity
    balances, would make any error small.
    """
    misses, torques = [], []
    for run in log.runs:
        m = filtered_motion(run, cutoff, model)
        edge = min(m.time.size // 10, round(2.0 / (cutoff * run.sample_time)))
        inner = slice(edge, m.time.size - edge)
        misses.append((m.torque - needed_torque(own_model(run, model), m))[inner])
        torques.append(filtered_motion(run, cutoff).torque[inner])
    return np.concatenate(misses), np.concatenate(torques)


def needed_torque(model: ServoModel, motion: FilteredMotion) -> Array:
    """(T,) torque after the actuator that is needed for the motion [N m]: eq. (4) solved for it, drivetrain rigid.

    At standstill dry friction balances a range of torques: the one nearest to the measured torque is taken.
    """
    travels = np.diff(motion.angle, prepend=motion.angle[0])
    rows = np.column_stack(
        (motion.angle, motion.velocity, motion.time, motion.torque, travels, motion.still.astype(float))
    )
    step = np.array([motion.time[1] - motion.time[0]])
    _, (torque, inertia) = _passive(Structure(model))((np.zeros(len(model.states)),), rows, model.values, step)
    return inertia[:, 0] * motion.acceleration + torque[:, 0]


@recursion(carried=1)
def _passive(structure: Structure) -> Any:
    """(state), rows of motion, parameters, time step -> needed torque without that of the acceleration, inertia."""
    template = structure.model
    state, parameters = ca.SX.sym("state", len(template.states)), ca.SX.sym("parameters", len(template.names))
    row, dt, model = ca.SX.sym("row", 6), ca.SX.sym("dt"), template.bound(parameters)
    x, v, t, torque, travel, at_rest = ca.vertsplit(row)
    own = model.own_states(state)
    at = Moment(angle=x, velocity=v, torque=torque, time=t, travel=travel, step=dt)
    free = torque - model.load_inertia(at) * model.smooth_acceleration(at, own)
    levels = model.dry_friction(at)
    if levels is not None:
        holds = ca.fmax(ca.fmin(torque - free, levels[0]), -levels[1])
        free += ca.if_else(at_rest, holds, ca.if_else(v > 0, levels[0], -levels[1]) * ca.fabs(ca.sign(v)))
    inertia = model.inertia + sum((effect.added_inertia(at) for effect in model.effects), start=0.0)
    slid = [
        effect.slide(own[effect.name][i], travel) if kind is State.RELAXED else own[effect.name][i]
        for effect in model.effects
        for i, kind in enumerate(effect.states)
    ]
    outputs = [ca.densify(value) for value in (ca.vertcat(x, v, *slid), ca.SX(free), ca.SX(inertia))]
    return ca.Function("passive", [state, row, parameters, dt], outputs, {"cse": True})


def _true_angle(model: ServoModel, measured: Array) -> Array:
    """(T,) true angle for a measured angle (T,) of a sensor with a small error; sensor lag is not corrected."""
    if all(effect.states or type(effect).measurement is Effect.measurement for effect in model.effects):
        return measured  # no static sensor error
    shown = _shown(Structure(model))((), measured[:, None], model.values)[1][0][:, 0]
    return np.asarray(measured - (shown - measured))


@recursion(carried=0)
def _shown(structure: Structure) -> Any:
    """Rows of an angle, parameters -> measured angle with sensor effects that have no state."""
    angle, parameters = ca.SX.sym("angle"), ca.SX.sym("parameters", len(structure.model.names))
    shown = angle
    for effect in structure.model.bound(parameters).effects:
        if not effect.states:
            shown = effect.measurement(shown, 0.0)
    return ca.Function("shown", [angle, parameters], [shown])
