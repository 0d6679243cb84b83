"""The predictor linearised along a log: what a small torque on the load, or error of the reading, does to innovations.

    s[k+1] = A[k] (s[k] + gain[k] de[k]) + B[k] d[k],      de[k] = -C[k] s[k] - r[k],

with d a torque on the load and r an error of the reading. The recursion is cut into blocks that are followed side by
side, so that a long log takes a few hundred array operations instead of one for every sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identification.log import Run
from identification.predictor import Prediction, moves_with, run_inputs
from plant.discrete import INPUTS, sample_reading, sample_step
from plant.effects.effect import Array, Effect, Expression, Moment, parameter
from plant.servo import ServoModel

_AT_ONCE = 32  # columns that are followed together, to bound the memory


@dataclass(frozen=True, kw_only=True, eq=False)
class Linear:
    """The predictor of one run, linearised along its path.

    Attributes:
        closed_loop: (T, n, n) next state by state, the observer's correction included.
        by_torque: (T, n) next state by a torque on the load.
        by_reading: (T, n) next state by an error of the reading.
        seen: (T, n) reading by state.
        weight: (T,) one where the sample counts.
    """

    closed_loop: Array
    by_torque: Array
    by_reading: Array
    seen: Array
    weight: Array

    def response(self, columns: Array, on_reading: NDArray[np.bool_]) -> Array:
        """(T, M) change of the innovations by torques, or errors of the reading where marked (M,), of (T, M)."""
        path = np.where(on_reading, self.by_reading[:, :, None], self.by_torque[:, :, None])
        states = recursion(self.closed_loop, path * columns[:, None, :])
        shown = np.einsum("kn,knm->km", self.seen, states) + columns * on_reading
        return np.asarray(-self.weight[:, None] * shown)

    def score(self, innovations: Array) -> tuple[Array, Array]:
        """(T,) see the function `score`."""
        push = self.weight * innovations
        backwards = self.closed_loop.transpose(0, 2, 1)[::-1]
        later = recursion(backwards, (push[:, None] * self.seen)[::-1, :, None])[::-1, :, 0]
        return (self.by_torque * later).sum(axis=1), push + (self.by_reading * later).sum(axis=1)


def recursion(transition: Array, push: Array) -> Array:
    """(T, n, M) states z[k] of z[k+1] = A[k] z[k] + b[k] from z[0] = 0, with A (T, n, n) and b (T, n, M)."""
    samples, n, columns = push.shape
    length = int(np.ceil(np.sqrt(samples)))
    blocks = int(np.ceil(samples / length))
    short = blocks * length - samples
    A = np.concatenate((transition, np.zeros((short, n, n)))).reshape(blocks, length, n, n)
    b = np.concatenate((push, np.zeros((short, n, columns)))).reshape(blocks, length, n, columns)
    state, through = np.zeros((blocks, n, columns)), np.tile(np.eye(n), (blocks, 1, 1))
    for k in range(length):
        state = A[:, k] @ state + b[:, k]
        through = A[:, k] @ through
    begin = np.zeros((blocks, n, columns))
    for block in range(blocks - 1):
        begin[block + 1] = through[block] @ begin[block] + state[block]
    states, state = np.empty_like(b), begin
    for k in range(length):
        states[:, k] = state
        state = A[:, k] @ state + b[:, k]
    return states.reshape(-1, n, columns)[:samples]


def response(runs: tuple[Linear, ...], columns: Array, on_reading: NDArray[np.bool_]) -> Array:
    """(T, M) change of the innovations of all runs by torques, or where marked (M,) errors of the reading, (T, M)."""
    parts, row = [], 0
    for linear in runs:
        rows = columns[row : row + linear.weight.size]
        row += linear.weight.size
        pieces = [slice(first, first + _AT_ONCE) for first in range(0, columns.shape[1], _AT_ONCE)]
        parts.append(np.hstack([linear.response(rows[:, piece], on_reading[piece]) for piece in pieces]))
    return np.vstack(parts)


def score(runs: tuple[Linear, ...], innovations: Array) -> tuple[Array, Array]:
    """How much a load torque at each sample alone would lower half the squared innovations, and so an error of reading.

    By the adjoint of the predictor: one pass backwards instead of one pass for every sample.

    Args:
        runs: the predictor along each run.
        innovations: (T,) of all runs.

    Returns:
        (T,) per unit of torque, (T,) per unit of the reading.
    """
    ends = np.cumsum([linear.weight.size for linear in runs])
    pieces = np.split(innovations, ends[:-1])
    scores = [linear.score(piece) for linear, piece in zip(runs, pieces, strict=True)]
    return np.concatenate([torque for torque, _ in scores]), np.concatenate([reading for _, reading in scores])


@dataclass(frozen=True, kw_only=True)
class _Push(Effect):
    """A torque on the load, to differentiate by."""

    name = "push"
    torque: float = parameter("{torque}", "torque on the load")

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        return self.torque


def linearised(model: ServoModel, run: Run, prediction: Prediction, bandwidth: float, *, substeps: int) -> Linear:
    """A run's predictor linearised along its path, with a torque on the load as its input."""
    probe = model.with_effect(_Push(torque=0.0))
    place = probe.names.index("push.torque")
    n, count = len(probe.states), len(probe.names)
    state, inputs, parameters = ca.SX.sym("z", n), ca.SX.sym("u", len(INPUTS)), ca.SX.sym("p", count)
    following = sample_step(probe, substeps=substeps)(state, inputs, parameters)
    shown = sample_reading(probe)(state, parameters)
    by_state, by_offset = ca.jacobian(following, state), ca.jacobian(following, parameters[place])
    outputs = [ca.densify(by_state), ca.densify(by_offset), ca.densify(ca.jacobian(shown, state)).T]
    slopes = ca.Function("slopes", [state, inputs, parameters], outputs, {"cse": True})
    data, values = run_inputs(run, probe, probe.values, bandwidth, 0.0)
    gain = moves_with(probe) @ data[-2:]
    corrected = prediction.states + gain * prediction.innovations
    samples = data.shape[1]
    found = slopes.map(samples)(corrected, data[: len(INPUTS)], values)
    transition = np.array(found[0]).reshape(n, -1, n).transpose(1, 0, 2)
    seen = np.array(found[2]).T
    by_reading = np.einsum("kij,jk->ki", transition, gain)
    return Linear(
        closed_loop=transition - by_reading[:, :, None] * seen[:, None, :],
        by_torque=np.array(found[1]).T,
        by_reading=-by_reading,
        seen=seen,
        weight=run.valid.astype(float),
    )
