"""One-step prediction of a log by a servo model, with sensitivities: the basis of every fit and every test.

The predictor is an observer around the step of the plant model,

    e[k] = y[k] - measurement(state[k]),      state[k] <- state[k] + gain * e[k],      state[k+1] = step(state[k]),

with the gain of the stationary Kalman filter for a random load torque. The gain has a closed form (Kalata 1984,
alpha-beta filter) with one parameter, here the observer bandwidth w in rad/s: the square root of the ratio of the
acceleration noise to the measurement noise. At w = 0 nothing is corrected, and e is the error of a free simulation
(output error). At w > 0 the prediction does not drift, so that closed-loop logs and integrating plants are harmless. If
only the velocity is measured, the error is that of the velocity, and only the velocity is corrected.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from identification.log import Log, Run
from identification.noise import Whitening
from identification.observer_gain import correcting_gain
from identification.observer_steps import FADING, ObserverSteps, drivetrain_states, moves_with
from identification.recording import Response
from identification.run_parameters import own_slopes, own_values
from plant.discrete import INPUTS, Structure, integration_steps
from plant.effects.effect import Array
from plant.effects.setpoint_rate_limit import first_setpoint
from plant.measured_torque import supporting_points
from plant.servo import ServoModel
from plant.simulation import beginning, whole_samples

PIECE = 4096  # samples that are processed at once, to limit the memory
_TO_THE_NEXT = -1  # delay of a measured torque in samples: it is interpolated from each sample to the next


DIVERGED = 1e3
"""Growth of an initial error beyond which all sensitivities are nearly parallel, and the rest is rounding."""

HELD = 0.5 * FADING
"""Observer bandwidth at which a chaotic model follows the log [rad/sample]."""


def measured_state(response: Response) -> int:
    """Index of the measured one of initial angle (0) and velocity (1); the slope by it has no unit."""
    return 1 if response == "velocity" else 0


def steps_in_a_sample(model: ServoModel, log: Log) -> int:
    """Integration steps per sample that are needed for a model, also in the position loop of a log, at its speeds."""
    stiffness = max(float(np.max(np.abs(run.servo_gain))) for run in log.runs)
    damping = max(float(np.max(np.abs(run.servo_damping))) for run in log.runs)
    speed = max(map(_highest_speed, log.runs))
    return integration_steps(model, log.sample_time, stiffness=stiffness, damping=damping, speed=speed)


@lru_cache(maxsize=64)
def _highest_speed(run: Run) -> float:
    """Highest speed of a run [rad/s]: its 99 % quantile, as single wrong values are none."""
    shown = run.measured if run.response == "velocity" else run.output
    speed = shown[run.valid]
    if run.response != "velocity":
        speed = np.diff(speed) / np.diff(run.time[run.valid])
    return float(np.quantile(np.abs(speed), 0.99)) if speed.size else 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """Innovations of one run.

    Attributes:
        errors: (T,) measured less predicted angle, or velocity where that is measured; zero where masked.
        innovations: (T,) errors whitened with the colour of the measurement noise.
        jacobian: (T, F + I) their derivative with respect to the free parameters and the initial state, or (T, 0).
        states: (n, T) predicted states, before the measurement is used.
        output: (T,) predicted angle, or velocity.
        initials: I, how many numbers of the initial state are fitted.
    """

    errors: Array
    innovations: Array
    jacobian: Array
    states: Array
    output: Array
    initials: int = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Predictor:
    """A model's structure prepared to predict the runs of a log.

    Attributes:
        model: the structure; its parameter values are not used.
        runs: to be predicted.
        free: (F,) indices of the parameters of the Jacobian.
        substeps: integration steps in one sample.
        colour: autoregression of the measurement noise, see `identification.coloured_noise`.
        unsettled: whether the Jacobian is also that of the hidden initial states, see `identification.unsettled_start`.
    """

    model: ServoModel
    runs: tuple[Run, ...]
    free: tuple[int, ...]
    substeps: int = 1
    colour: tuple[float, ...] = ()
    unsettled: bool = False

    @property
    def fitted_starts(self) -> tuple[int, ...]:
        """(I,) the numbers of an initial state that are fitted: angle and velocity, and hidden states if `unsettled`.

        The states of a backlash are not fitted: the first impact makes them forgotten.
        """
        if not self.unsettled:
            return 0, 1
        forgotten = drivetrain_states(self.model) if self.model.chaotic else range(0)
        return tuple(place for place in range(len(self.model.states)) if place not in forgotten)

    def predict(
        self, values: Array, initial: Array, *, bandwidth: float, width: float, sensitivities: bool = True
    ) -> list[Prediction]:
        """Predict every run.

        Args:
            values: (P,) all parameters of the model.
            initial: (R, 2) angle and velocity at the first sample of each run, all other states settled; or (R, n) with
                the departures of the others from there.
            bandwidth: of the observer [rad/s]; 0 is a free simulation.
            width: smoothing of dry friction [rad/s]; 0 is the exact form.
            sensitivities: compute the Jacobian too.
        """
        found: list[list[Prediction]] = [[] for _ in self.runs]
        for run, piece in self.pieces(values, initial, bandwidth=bandwidth, width=width, sensitivities=sensitivities):
            found[run].append(piece)
        return [_joined(pieces) for pieces in found]

    def pieces(
        self, values: Array, initial: Array, *, bandwidth: float, width: float, sensitivities: bool = True
    ) -> Iterator[tuple[int, Prediction]]:
        """`predict` piece by piece, with the index of the run: a pass over a long log with little memory."""
        followed = self._followed(values, initial, bandwidth=bandwidth, width=width)
        if not sensitivities:
            return followed
        return self.with_sensitivities(followed, values, initial, bandwidth=bandwidth, width=width)

    def with_sensitivities(
        self, pieces: Iterable[tuple[int, Prediction]], values: Array, initial: Array, *, bandwidth: float, width: float
    ) -> Iterator[tuple[int, Prediction]]:
        """The pieces of all runs, predicted without Jacobian, and the Jacobian; arguments as in `predict`."""
        starts, last = self.fitted_starts, -1
        for place, piece in pieces:
            run = self.runs[place]
            if place != last:
                first, last, whitened = 0, place, Whitening(self.colour)
                own = own_slopes(run, self.model, values, self.free)
                slopes = np.zeros((len(self.free) + len(starts), len(self.model.states)))
                slopes[-len(starts) :] = initial_moves(self.model)[:, starts].T
            part = slice(first, first + len(piece.errors))
            rows, moved = run_inputs(run, self.model, values, bandwidth, width, part)
            slopes, jacobian = self._steps.sensitivities(slopes, piece.states.T, rows, moved, self.free)
            if own is not None:
                jacobian = np.hstack((jacobian[:, : -len(starts)] @ own, jacobian[:, -len(starts) :]))
            yield place, replace(piece, jacobian=_whitened(whitened, jacobian, ~run.valid[part]))
            first = part.stop

    def _followed(
        self, values: Array, initial: Array, *, bandwidth: float, width: float
    ) -> Iterator[tuple[int, Prediction]]:
        for place, (run, start) in enumerate(zip(self.runs, initial, strict=True)):
            state, whitened = self.settled(run, values, start), Whitening(self.colour)
            state[2 : start.size] += start[2:]
            for first in range(0, len(run), PIECE):
                part = slice(first, min(first + PIECE, len(run)))
                rows, moved = run_inputs(run, self.model, values, bandwidth, width, part)
                state, errors, states = self._steps.follow(state, rows, moved)
                output, masked = rows[:, len(INPUTS)] - errors, ~run.valid[part]
                innovations = _whitened(whitened, errors[:, None], masked)[:, 0]
                yield (
                    place,
                    Prediction(
                        errors=np.where(masked, 0.0, errors),
                        innovations=innovations,
                        jacobian=np.empty((len(errors), 0)),
                        states=states.T,
                        output=output,
                        initials=len(self.fitted_starts),
                    ),
                )

    @property
    def _steps(self) -> ObserverSteps:
        return ObserverSteps(
            structure=Structure(self.model),
            substeps=self.substeps,
            positioned=any(run.positioned for run in self.runs),
            response=self.runs[0].response,
        )

    def settled(self, run: Run, values: Array, start: Array) -> Array:
        """(n,) state at the first sample of a run with an angle and a velocity (2,), all else settled."""
        (first,), _ = run_inputs(run, self.model, values, 0.0, 0.0, slice(0, 1))
        return beginning(
            self.model,
            angle=start[0],
            velocity=start[1],
            torque=first[0] - first[2] * start[0] - first[INPUTS.index("servo_damping")] * start[1],
            command=first[0],
            setpoint=first_setpoint(run.command, run.servo_gain),
        )


def _whitened(whitened: Whitening, values: Array, masked: NDArray[np.bool_]) -> Array:
    """(T, M) the next values of a run, whitened; zero where masked."""
    values[masked] = 0.0  # not times zero: a simulation that overflows is infinite
    white = whitened(values)
    white[masked] = 0.0
    return white


def _joined(pieces: Sequence[Prediction]) -> Prediction:
    if len(pieces) == 1:
        return pieces[0]
    return Prediction(
        errors=np.concatenate([p.errors for p in pieces]),
        innovations=np.concatenate([p.innovations for p in pieces]),
        jacobian=np.concatenate([p.jacobian for p in pieces]),
        states=np.concatenate([p.states for p in pieces], axis=1),
        output=np.concatenate([p.output for p in pieces]),
        initials=pieces[0].initials,
    )


def run_inputs(
    run: Run, model: ServoModel, values: Array, bandwidth: float, width: float, part: slice
) -> tuple[Array, Array]:
    """(k, 11) inputs of the steps of a part of a run, with measurement and gains, and the run's parameters (P,).

    The whole samples of a dead time are in the inputs; the parameters only have the rest, less than a sample.
    """
    values, whole = own_values(run, model, values), 0
    if "input_delay.time" in model.names:
        delay, values = model.names.index("input_delay.time"), values.copy()
        whole, values[delay] = whole_samples(float(values[delay]), run.sample_time)
    if model.lead() is not None:
        whole = _TO_THE_NEXT
    return _rows(run, part.start, part.stop, whole, bandwidth, width), values


@lru_cache(maxsize=64)
def _rows(run: Run, start: int, stop: int, whole: int, bandwidth: float, width: float) -> Array:
    """The inputs of a part of a run with a dead time of whole samples; cached, as each pass of a fit uses them."""
    part = slice(start, stop)
    dt = np.diff(run.time[start : stop + 1])
    if stop == len(run):
        dt = np.append(dt, run.time[-1] - run.time[-2])
    gains = correcting_gain(run, bandwidth, dt)
    rows = np.empty((dt.size, len(INPUTS) + 1 + len(gains)))
    command = supporting_points(run.command) if whole == _TO_THE_NEXT else run.command
    columns = (
        _delayed(command, whole, part),
        _delayed(command, whole + 1, part),
        run.servo_gain[part],
        run.command_limit,
        run.time[part],
        dt,
        width,
        run.servo_damping[part],
        run.measured[part],
        *gains,
    )
    for place, column in enumerate(columns):
        rows[:, place] = column
    rows[~run.valid[part], len(INPUTS) :] = 0.0
    rows.flags.writeable = False
    return rows


def _delayed(values: Array, samples: int, part: slice) -> Array:
    """A part of values (T,) delayed by a number of samples (negative: advanced); the end values are repeated."""
    return np.asarray(values[np.clip(np.arange(part.start, part.stop) - samples, 0, values.size - 1)])


def initial_moves(model: ServoModel) -> Array:
    """(n, n) states that move with each number of an initial state: with angle, velocity, departures of the others."""
    return np.hstack((moves_with(model)[:, :2], np.eye(len(model.states))[:, 2:]))
