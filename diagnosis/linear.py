"""The predictor linearised along a log: response of the innovations to a small load torque or measurement error.

    s[k+1] = A[k] (s[k] + gain[k] de[k]) + B[k] d[k],      de[k] = -C[k] s[k] - r[k],

with d a torque on the load and r an error of the measurement. Several inputs are simulated in parallel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import casadi as ca
import numpy as np

from identification.log import Run
from identification.noise import whiten
from identification.observer_steps import forgetful, moves_with, sample_shown
from identification.predictor import PIECE, Prediction, run_inputs
from identification.recording import Response
from plant.discrete import INPUTS, Structure
from plant.effects.effect import Array
from plant.effects.given_load import GivenLoad
from plant.recursion_cache import recursion
from plant.sensitivity import step_with_slopes
from plant.servo import ServoModel

AT_ONCE = 16  # columns that are simulated in parallel
HUGE = 1e100  # values that have overflowed, or will when they are squared


@dataclass(frozen=True, kw_only=True, eq=False)
class Linear:
    """The predictor of one run, linearised along its path.

    Attributes:
        closed_loop: (T, n, n) derivative of the next state by the state, the observer's correction included.
        by_torque: (T, n) derivative of the next state by a torque on the load.
        by_measurement: (T, n) derivative of the next state by an error of the measurement.
        seen: (T, n) derivative of the measurement by the state.
        weight: (T,) one for valid samples, else zero.
        colour: autoregressive coefficients of the measurement noise; the innovations are whitened with them.
    """

    closed_loop: Array
    by_torque: Array
    by_measurement: Array
    seen: Array
    weight: Array
    colour: tuple[float, ...] = ()

    def response(self, columns: Array, *, on_measurement: bool = False) -> Array:
        """(T, M) change of the innovations by torques (T, M), or by errors of the measurement."""
        path = self.by_measurement if on_measurement else self.by_torque
        found = np.empty(columns.shape)
        for first in range(0, columns.shape[1], AT_ONCE):
            some = slice(first, first + AT_ONCE)
            found[:, some] = follow(self.closed_loop, path, self.seen, columns[:, some])
        if on_measurement:
            found += columns
        found *= -self.weight[:, None]
        return whiten(found, np.array(self.colour)) * self.weight[:, None] if self.colour else found

    def score(self, innovations: Array) -> tuple[Array, Array]:
        """(T, M) see the function `score`; M at most `AT_ONCE`."""
        push = self.weight[:, None] * innovations
        if self.colour:
            push = self.weight[:, None] * whiten(push[::-1], np.array(self.colour))[::-1]
        backwards, seen = self.closed_loop.transpose(0, 2, 1)[::-1], self.seen[::-1]
        torque, measurement = (
            follow(backwards, seen, path[::-1], push[::-1])[::-1] for path in (self.by_torque, self.by_measurement)
        )
        return torque, push + measurement


@dataclass(frozen=True, kw_only=True, eq=False)
class InverseLinear:
    """The inverse predictor of one run: a torque on the load changes its innovations by as much.

    Attributes:
        weight: (T,) one for valid samples, else zero.
    """

    weight: Array

    def response(self, columns: Array, *, on_measurement: bool = False) -> Array:
        """(T, M) change of the innovations by torques (T, M); the motion is given without error."""
        return np.zeros_like(columns) if on_measurement else self.weight[:, None] * columns

    def score(self, innovations: Array) -> tuple[Array, Array]:
        """(T, M) see the function `score`."""
        return -self.weight[:, None] * innovations, np.zeros_like(innovations)


Filter: TypeAlias = Linear | InverseLinear
"""What turns a small torque on the load into a change of the innovations."""


def follow(transition: Array, path: Array, seen: Array, columns: Array) -> Array:
    """(T, M) outputs C[k] z[k] of z[k+1] = A[k] z[k] + B[k] u[k] from z[0] = 0.

    Args:
        transition: (T, n, n) A.
        path: (T, n) B.
        seen: (T, n) C.
        columns: (T, M) inputs u, at most `AT_ONCE`.
    """
    (samples, n), m = path.shape, columns.shape[1]
    found, rows = np.empty((samples, m)), np.zeros((min(samples, PIECE), n * n + 2 * n + AT_ONCE))
    places, state = np.cumsum([n * n, n, n, m]), [np.zeros(n * AT_ONCE)]
    for first in range(0, samples, PIECE):
        piece = slice(first, min(first + PIECE, samples))
        part = rows[: piece.stop - first]
        flat = transition[piece].reshape(-1, n * n)
        for values, stop in zip((flat, path[piece], seen[piece], columns[piece]), places, strict=True):
            part[:, stop - values.shape[1] : stop] = values
        state, (shown,) = _side_by_side(n)(state, part)
        found[piece] = shown[:, :m]
    return found


@recursion(carried=1)
def _side_by_side(n: int) -> Any:
    """The recursion of `follow` for n states."""
    z, row = ca.SX.sym("z", n, AT_ONCE), ca.SX.sym("row", n * n + 2 * n + AT_ONCE)
    flat, path, seen, columns = ca.vertsplit(row, [0, n * n, n * n + n, n * n + 2 * n, row.numel()])
    following = ca.mtimes(ca.reshape(flat, n, n).T, z) + ca.mtimes(path, columns.T)
    return ca.Function("side_by_side", [z, row], [following, ca.mtimes(seen.T, z)])


def response(runs: tuple[Filter, ...], columns: Array, *, on_measurement: bool) -> Array:
    """(T, M) change of the innovations of all runs by torques (T, M), or by errors of the measurement.

    Where the response of a free simulation diverges it is zero.
    """
    pieces = np.split(columns, np.cumsum([linear.weight.size for linear in runs])[:-1])
    parts = [linear.response(piece, on_measurement=on_measurement) for linear, piece in zip(runs, pieces, strict=True)]
    found = parts[0] if len(parts) == 1 else np.vstack(parts)
    bounded = np.abs(found) < HUGE  # nor is it where the response is not a number
    if not bounded.all():
        found[~bounded] = 0.0
    return found


def score(runs: tuple[Filter, ...], innovations: Array) -> tuple[Array, Array]:
    """Negative gradient of half the squared innovations by load torques and measurement errors, one at each sample.

    It is calculated with the adjoint of the predictor: one backward pass instead of one pass for every sample.

    Args:
        runs: the predictor along each run.
        innovations: (T, M) of all runs, M vectors of innovations, at most `AT_ONCE`.

    Returns:
        (T, M) per unit of torque, (T, M) per unit of the measurement.
    """
    ends = np.cumsum([linear.weight.size for linear in runs])
    pieces = np.split(innovations, ends[:-1])
    scores = [linear.score(piece) for linear, piece in zip(runs, pieces, strict=True)]
    return np.concatenate([torque for torque, _ in scores]), np.concatenate([measurement for _, measurement in scores])


def linearised(
    model: ServoModel,
    run: Run,
    prediction: Prediction,
    bandwidth: float,
    *,
    substeps: int,
    colour: tuple[float, ...] = (),
) -> Filter:
    """A run's predictor linearised along its path, with a torque on the load as its input."""
    if run.response == "torque":
        return InverseLinear(weight=run.valid.astype(float))
    probe = model.with_effect(GivenLoad(torque=0.0))
    n, samples = len(probe.states), len(run)
    closed_loop, seen = np.empty((samples, n, n)), np.empty((samples, n))
    by_torque, by_measurement = np.empty((samples, n)), np.empty((samples, n))
    for first in range(0, samples, PIECE):
        part = slice(first, min(first + PIECE, samples))
        rows, values = run_inputs(run, probe, probe.values, bandwidth, 0.0, part)
        gain = rows[:, len(INPUTS) + 1 :] @ moves_with(probe).T
        corrected = prediction.states[:, part].T + gain * prediction.errors[part, None]
        inputs = np.hstack((corrected, rows[:, : len(INPUTS)]))
        _, (slopes, seen[part]) = _slopes(Structure(probe), substeps, run.positioned, run.response)((), inputs, values)
        transition = slopes[:, n:].reshape(-1, n, n).transpose(0, 2, 1)
        by_torque[part], by_measurement[part] = slopes[:, :n], -np.einsum("kij,kj->ki", transition, gain)
        closed_loop[part] = transition + by_measurement[part, :, None] * seen[part, None, :]
    return Linear(
        closed_loop=closed_loop,
        by_torque=by_torque,
        by_measurement=by_measurement,
        seen=seen,
        weight=run.valid.astype(float),
        colour=colour,
    )


@recursion(carried=0)
def _slopes(structure: Structure, substeps: int, positioned: bool, response: Response) -> Any:
    """(state, inputs) at each sample, parameters -> derivatives of the next state and of the measurement.

    The derivatives are by torque and state. Each sample is independent of the others.
    """
    probe = structure.model
    n, load = len(probe.states), probe.names.index("given_load.torque")
    step = step_with_slopes(probe, (load,), 1 + n, substeps=substeps, positioned=positioned)
    kind: Any = ca.SX if step.is_a("SXFunction") else ca.MX
    row, parameters = kind.sym("row", n + len(INPUTS)), kind.sym("parameters", len(probe.names))
    followed = forgetful(probe, kind(np.hstack((np.zeros((n, 1)), np.eye(n)))))
    _, slopes = step(row[:n], followed, row[n:], parameters)
    state, own = ca.SX.sym("state", n), ca.SX.sym("parameters", len(probe.names))
    shown = ca.densify(ca.jacobian(sample_shown(probe, response)(state, own), state))
    seen = ca.Function("seen", [state, own], [shown])(row[:n], parameters)
    return ca.Function("slopes", [row, parameters], [slopes, seen])
