"""The steps of the observer along a log: its states one after the other, then their sensitivities.

With `y` the measurement and `p` the parameters, a step and its sensitivities `S` are

    e[k] = y[k] - h(x[k], p),      x[k+1] = f(x[k] + gain * e[k], p),
    de/dp[k] = E_x[k] S[k] + E_p[k],      S[k+1] = A[k] S[k] + B[k].

The recursion of the states is nonlinear and short. The derivatives A, B, E of one step are long expressions, but once
the states are known each sample has its own: they are computed for many samples at once. The recursion of the
sensitivities is a product of small matrices.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from identification.recording import Response
from plant.discrete import INPUTS, Structure, sample_reading
from plant.effects import State
from plant.effects.effect import Array
from plant.recursion_cache import recursion
from plant.sensitivity import step_with_slopes
from plant.servo import ServoModel
from plant.symbolic import one_at_a_time

FADING = 0.15
"""Rate at which sensitivities that grow without bound are damped [1/sample]."""


@dataclass(frozen=True, kw_only=True)
class ObserverSteps:
    """The steps along the runs of a log.

    Attributes:
        structure: of the model.
        substeps: integration steps in one sample.
        positioned: whether the servo gain may be other than zero.
        response: measured quantity.
    """

    structure: Structure
    substeps: int
    positioned: bool
    response: Response

    def follow(self, state: Array, rows: Array, values: Array) -> tuple[Array, Array, Array]:
        """Follow a part of a log, sample by sample.

        Args:
            state: (n,) at the first sample.
            rows: (T, 11) inputs of the steps with measurement and gains, as of `predictor.run_inputs`.
            values: (P,) parameters.

        Returns:
            (n,) state after the last sample, (T,) errors, (T, n) states.
        """
        step = _states(self.structure, self.substeps, self.positioned, self.response)
        (state,), (errors, states) = step((state,), rows, values)
        return state, errors[:, 0], states

    def sensitivities(
        self, slopes: Array, states: Array, rows: Array, values: Array, free: tuple[int, ...]
    ) -> tuple[Array, Array]:
        """The sensitivities of a part of a log that has been followed.

        Args:
            slopes: (F + I, n) by the parameters and by I numbers of the initial state, at the first sample.
            states: (T, n) along the part.
            rows, values: as in `follow`.
            free: (F,) places of the parameters.

        Returns:
            (F + I, n) sensitivities after the last sample, (T, F + I) those of the errors.
        """
        derivatives = _derivatives(self.structure, free, self.substeps, self.positioned, self.response)
        _, found = derivatives((), np.hstack((states, rows)), values)
        step = _sensitivities(states.shape[1], len(free), len(slopes) - len(free))
        (last,), (by_point,) = step((slopes,), np.hstack(found))
        return last.reshape(slopes.shape), by_point


@recursion(carried=1)
def _states(structure: Structure, substeps: int, positioned: bool, response: Response) -> Any:
    """(state), rows, parameters -> error and state at each sample."""
    model = structure.model
    n = len(model.states)
    step = step_with_slopes(model, (), 0, substeps=substeps, positioned=positioned)
    state, row, parameters = ca.SX.sym("state", n), _row(model), ca.SX.sym("parameters", len(model.names))
    error, correction = _error(model, response, state, row, parameters)
    outputs = [ca.densify(value) for value in (state + correction * error, error)]
    correct = ca.Function("correct", [state, row, parameters], outputs, {"cse": True})

    kind: Any = ca.SX if step.is_a("SXFunction") else ca.MX
    entering = [kind.sym("entering", *value.shape) for value in (state, row, parameters)]
    corrected, seen = correct(*entering)
    following, _ = step(corrected, kind(n, 0), entering[1][: len(INPUTS)], entering[2])
    return ca.Function("states", entering, [following, seen, entering[0]], {"cse": kind is ca.SX})


@recursion(carried=0)
def _derivatives(
    structure: Structure, free: tuple[int, ...], substeps: int, positioned: bool, response: Response
) -> Any:
    """Rows of a state and its `_states` row, parameters -> B and A of the next state, E_p and E_x of the error."""
    model = structure.model
    n, columns = len(model.states), len(free) + len(model.states)
    step = step_with_slopes(model, free, columns, substeps=substeps, positioned=positioned)
    state, row, parameters = ca.SX.sym("state", n), _row(model), ca.SX.sym("parameters", len(model.names))
    error, correction = _error(model, response, state, row, parameters)
    by_parameters, by_state = ca.jacobian(error, parameters[list(free)]), ca.jacobian(error, state)
    error_slopes = ca.horzcat(by_parameters, by_state)
    followed = ca.horzcat(ca.SX(n, len(free)), ca.SX.eye(n)) + ca.mtimes(correction, error_slopes)
    outputs = [ca.densify(v) for v in (state + correction * error, forgetful(model, followed), error_slopes)]
    correct = ca.Function("correct", [state, row, parameters], outputs, {"cse": True})

    kind: Any = ca.SX if step.is_a("SXFunction") else ca.MX
    entering = kind.sym("entering", n + row.numel()), kind.sym("parameters", len(model.names))
    corrected, slopes, seen_slopes = correct(entering[0][:n], entering[0][n:], entering[1])
    _, following = step(corrected, slopes, entering[0][n : n + len(INPUTS)], entering[1])
    return ca.Function("derivatives", entering, [following, seen_slopes], {"cse": kind is ca.SX})


@recursion(carried=1)
def _sensitivities(n: int, free: int, initials: int) -> Any:
    """(S), rows of `_derivatives` -> sensitivities of the error."""
    slopes, columns = ca.SX.sym("slopes", n, free + initials), free + n
    row = ca.SX.sym("row", (n + 1) * columns)
    moved, seen = ca.reshape(row[: n * columns], n, columns), row[n * columns :].T

    def along(step: Any) -> Any:
        beside = ca.horzcat(step[:, :free], ca.SX(step.shape[0], initials))
        return ca.densify(ca.mtimes(step[:, free:], slopes) + beside)

    return ca.Function("sensitivities", [slopes, row], [along(moved), along(seen)])


def _row(model: ServoModel) -> Any:
    return ca.SX.sym("row", len(INPUTS) + 3)


def _error(model: ServoModel, response: Response, state: Any, row: Any, parameters: Any) -> tuple[Any, Any]:
    """Error of the predicted measurement, and (n,) change of the state per unit of it."""
    error = row[len(INPUTS)] - sample_shown(model, response)(state, parameters)
    return error, ca.mtimes(ca.DM(moves_with(model)), row[len(INPUTS) + 1 :])


def sample_shown(model: ServoModel, response: Response) -> Any:
    """The measured quantity as a Function of (n,) state and (P,) parameters; a velocity is that of the load."""
    if response == "angle":
        return sample_reading(model)
    return _sample_velocity(len(model.states), len(model.names))


@one_at_a_time
def _sample_velocity(states: int, parameters: int) -> Any:
    state, values = ca.SX.sym("state", states), ca.SX.sym("parameters", parameters)
    return ca.Function("sample_velocity", [state, values], [state[1]])


def moves_with(model: ServoModel) -> Array:
    """(n, 2) states that an observer corrects together with the angle, and together with the velocity."""
    return np.array([[kind is one for one in (State.ANGLE, State.VELOCITY)] for kind in model.kinds], dtype=float)


def drivetrain_states(model: ServoModel) -> range:
    """Places of the states of the drivetrain."""
    motor = model.drivetrain
    if motor is None:
        return range(0)
    first = 2 + sum(len(effect.states) for effect in model.effects[: model.effects.index(motor)])
    return range(first, first + len(motor.states))


def forgetful(model: ServoModel, slopes: Any) -> Any:
    """Sensitivities (n, columns) in which those of a chaotic drivetrain are damped.

    After a few impacts in quick succession the exact sensitivities are extremely large and meaningless. So the
    sensitivity of the motor's motion relative to the load decays at the rate `FADING`: it is kept about from one
    reversal to the next.
    """
    motor = model.drivetrain
    if motor is None or not motor.chaotic:
        return slopes
    first = drivetrain_states(model).start
    rows = ca.vertsplit(slopes)
    kept = np.exp(-FADING)
    for place in (0, 1):
        rows[first + place] = rows[place] + kept * (rows[first + place] - rows[place])
    return ca.vertcat(*rows)
