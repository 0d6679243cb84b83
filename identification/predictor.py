"""One-step prediction of a log by a servo model, with sensitivities: what every fit and every test rests on.

The predictor is an observer around the plant's own step,

    e[k] = y[k] - reading(state[k]),      state[k] <- state[k] + gain * e[k],      state[k+1] = step(state[k]),

with the gain of the stationary Kalman filter for a load torque that fluctuates at random. That gain has a closed form
(Kalata 1984, alpha-beta filter) in one number, here the observer's bandwidth w in rad/s: the square root of the ratio
of the acceleration noise to the measurement noise. At w = 0 nothing is corrected and e is the error of a free
simulation (output error); above it nothing drifts, so that closed-loop logs and integrating plants are harmless.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identification.log import Run
from plant.discrete import INPUTS, sample_reading, sample_step
from plant.effects import State
from plant.effects.effect import Array
from plant.effects.goal_rate_limit import goals
from plant.machine_code import MachineCode
from plant.servo import ServoModel
from plant.simulation import beginning, held_commands

CHUNK = 250  # samples that one compiled call covers; a run is a few such calls


def observer_gain(bandwidth: float, dt: Array) -> Array:
    """(2, T) gain on angle [-] and velocity [1/s] of the alpha-beta filter (Kalata 1984, eqs. for the tracking index).

    Args:
        bandwidth: square root of acceleration noise [rad/s^2] over measurement noise [rad]: [rad/s].
        dt: (T,) time step of each sample [s].
    """
    index = (bandwidth * dt) ** 2
    r = (4.0 + index - np.sqrt(8.0 * index + index**2)) / 4.0
    alpha = 1.0 - r**2
    beta = 2.0 * (2.0 - alpha) - 4.0 * np.sqrt(1.0 - alpha)
    return np.stack((alpha, beta / np.maximum(dt, 1e-12)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """Innovations of one run.

    Attributes:
        innovations: (T,) measured less predicted output; zero where the sample is masked.
        jacobian: (T, F + 2) their derivative with respect to the free parameters and the initial angle and velocity.
        states: (n, T) predicted states, before the measurement is used.
        output: (T,) predicted output.
    """

    innovations: Array
    jacobian: Array
    states: Array
    output: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Predictor:
    """A model's structure prepared to predict the runs of a log.

    Attributes:
        model: the structure; its numbers are not used.
        runs: what to predict.
        free: (F,) places of the parameters to differentiate for.
        substeps: integration steps in one sample.
    """

    model: ServoModel
    runs: tuple[Run, ...]
    free: tuple[int, ...]
    substeps: int = 1

    def predict(
        self, values: Array, initial: Array, *, bandwidth: float, width: float, sensitivities: bool = True
    ) -> list[Prediction]:
        """Predict every run.

        Args:
            values: (P,) all parameters of the model.
            initial: (R, 2) angle and velocity at the first sample of each run.
            bandwidth: of the observer [rad/s]; 0 is a free simulation.
            width: smoothing of dry friction [rad/s]; 0 is the exact form.
            sensitivities: compute the Jacobian too.
        """
        return [
            self._predict_run(run, values, start, bandwidth, width, sensitivities)
            for run, start in zip(self.runs, initial, strict=True)
        ]

    def _predict_run(
        self, run: Run, values: Array, start: Array, bandwidth: float, width: float, sensitivities: bool
    ) -> Prediction:
        model, size = self.model, run.time.size
        data, values = run_inputs(run, model, values, bandwidth, width)
        states = len(model.states)
        columns = len(self.free) + 2 if sensitivities else 0
        begin = beginning(
            model,
            angle=start[0],
            velocity=start[1],
            torque=data[0, 0] - data[2, 0] * start[0],
            command=data[0, 0],
            goal=float(goals(run.command, run.servo_gain)[0]),
        )
        spread = np.zeros((columns, states))
        if sensitivities:
            spread[-2:] = moves_with(model).T
        code = _code(_Key(model, self.free, self.substeps, sensitivities))
        chunk = _Chunk(code.function, states, columns, values)
        errors, slopes, path = np.empty(size), np.empty((size, columns)), np.empty((states, size))
        for first in range(0, size, CHUNK):
            rows = slice(first, min(first + CHUNK, size))
            begin, spread = chunk.advance(begin, spread, data[:, rows])
            kept = rows.stop - first
            errors[rows], path[:, rows] = chunk.errors[:kept], chunk.before[:kept].T
            slopes[rows] = chunk.slopes[:kept]
        weight = run.valid.astype(float)
        return Prediction(
            innovations=errors * weight,
            jacobian=slopes * weight[:, None],
            states=path,
            output=data[len(INPUTS)] - errors,
        )


def run_inputs(run: Run, model: ServoModel, values: Array, bandwidth: float, width: float) -> tuple[Array, Array]:
    """(10, T) inputs of each step with measurement and gain, and the parameters with the delay inside a sample."""
    dt = np.diff(run.time)
    dt = np.append(dt, dt[-1])
    place = model.names.index("input_delay.time") if "input_delay.time" in model.names else None
    now, before, switch = held_commands(run.command, dt, 0.0 if place is None else float(values[place]))
    if place is not None:
        values = values.copy()
        values[place] = switch
    gain = observer_gain(bandwidth, dt) * run.valid
    limit = np.full(dt.size, run.command_limit)
    output = np.where(run.valid, run.output, 0.0)
    inputs = (now, before, run.servo_gain, limit, run.time, dt, np.full(dt.size, width))
    return np.vstack((*inputs, output, gain)), values


def moves_with(model: ServoModel) -> Array:
    """(n, 2) which states an observer moves with its correction of the angle, and of the velocity."""
    return np.array([[kind is State.ANGLE, kind is State.VELOCITY] for kind in model.kinds], dtype=float)


class _Key:
    """What a compiled predictor depends on."""

    def __init__(self, model: ServoModel, free: Sequence[int], substeps: int, sensitivities: bool) -> None:
        self.model = model
        self.rest = (tuple(free), substeps, sensitivities)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and (self.model.structure, self.rest) == (other.model.structure, other.rest)

    def __hash__(self) -> int:
        return hash((self.model.structure, self.rest))


class _Chunk:
    """The compiled prediction of `CHUNK` samples with its memory: CasADi reads and writes these arrays in place."""

    def __init__(self, function: Any, states: int, columns: int, values: Array) -> None:
        self.begin, self.spread = np.zeros(states), np.zeros((columns, states))
        self.data = np.zeros((CHUNK, len(INPUTS) + 3))
        self.values = np.tile(np.asarray(values, dtype=float), (CHUNK, 1))
        self.states, self.spreads = np.zeros((CHUNK, states)), np.zeros((CHUNK, columns, states))
        self.errors, self.slopes, self.before = np.zeros(CHUNK), np.zeros((CHUNK, columns)), np.zeros((CHUNK, states))
        self.buffer, self.evaluate = function.buffer()
        for place, array in enumerate((self.begin, self.spread, self.data, self.values)):
            self.buffer.set_arg(place, memoryview(array.ravel()))  # type: ignore[arg-type]
        for place, array in enumerate((self.states, self.spreads, self.errors, self.slopes, self.before)):
            self.buffer.set_res(place, memoryview(array.ravel()))  # type: ignore[arg-type]

    def advance(self, begin: Array, spread: Array, data: Array) -> tuple[Array, Array]:
        """Predict up to `CHUNK` samples, data (10, k); returns state and spread behind the last one."""
        kept = data.shape[1]
        self.begin[:], self.spread[:] = begin, spread
        self.data[:kept], self.data[kept:] = data.T, 0.0
        self.evaluate()
        return self.states[kept - 1].copy(), self.spreads[kept - 1].copy()


@lru_cache(maxsize=512)
def _code(key: _Key) -> MachineCode:
    """Function (state, spread, data, parameters) -> states, spreads, innovations, slopes, predicted states."""
    free, substeps, sensitivities = key.rest
    step = sample_step(key.model, substeps=substeps)
    n, count, columns = len(key.model.states), len(key.model.names), len(free) + 2 if sensitivities else 0
    state, spread = ca.SX.sym("state", n), ca.SX.sym("spread", n, columns)
    data, parameters = ca.SX.sym("data", len(INPUTS) + 3), ca.SX.sym("parameters", count)
    inputs, measured, gain = data[: len(INPUTS)], data[len(INPUTS)], data[len(INPUTS) + 1 :]

    reading = sample_reading(key.model)
    error = measured - reading(state, parameters)
    correction = ca.mtimes(ca.DM(moves_with(key.model)), gain)
    corrected = state + correction * error
    if not sensitivities:
        outputs = [ca.densify(step(corrected, inputs, parameters)), spread, error, ca.SX(1, 0), state]
        one = ca.Function("predict", [state, spread, data, parameters], outputs, {"cse": True})
        return MachineCode(one.mapaccum("chunk", CHUNK, [0, 1], [0, 1]))

    at, moved = ca.SX.sym("at", n), ca.SX.sym("moved", count)
    following = step(at, inputs, moved)
    slopes = ca.Function(
        "slopes",
        [at, inputs, moved],
        [following, ca.jacobian(following, at), ca.jacobian(following, moved[list(free)] if free else ca.SX(0, 1))],
        {"cse": True},
    )
    moving = parameters[list(free)] if free else ca.SX(0, 1)
    shown = reading(state, parameters)
    error_slope = -ca.mtimes(ca.jacobian(shown, state), spread)
    error_slope -= ca.horzcat(ca.jacobian(shown, moving), ca.SX(1, 2))
    next_state, by_state, by_parameter = slopes(corrected, inputs, parameters)
    following_spread = ca.mtimes(by_state, spread + ca.mtimes(correction, error_slope))
    following_spread += ca.horzcat(by_parameter, ca.SX(n, 2))
    outputs = [ca.densify(next_state), ca.densify(following_spread), error, error_slope, state]
    one = ca.Function("predict", [state, spread, data, parameters], outputs, {"cse": True})
    return MachineCode(one.mapaccum("chunk", CHUNK, [0, 1], [0, 1]))


def stack(predictions: Sequence[Prediction]) -> tuple[Array, NDArray[np.float64]]:
    """Innovations (T,) and Jacobian (T, F + 2R) of all runs; each run has its own two columns of initial state."""
    innovations = np.concatenate([p.innovations for p in predictions])
    runs, free = len(predictions), predictions[0].jacobian.shape[1] - 2
    jacobian = np.zeros((innovations.size, free + 2 * runs))
    row = 0
    for place, p in enumerate(predictions):
        rows = slice(row, row + p.innovations.size)
        jacobian[rows, :free] = p.jacobian[:, :free]
        jacobian[rows, free + 2 * place : free + 2 * place + 2] = p.jacobian[:, free:]
        row = rows.stop
    return innovations, jacobian
