"""Free simulation of a log: the output of the model for the command alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from identification.inverse_predictor import InversePredictor
from identification.least_squares import Minimum, NormalEquations, minimise
from identification.log import Log, Run
from identification.objective import same_unit
from identification.predictor import HELD, Predictor, steps_in_a_sample
from identification.problem import first_states
from plant.effects.effect import Array
from plant.errors import BadParameter
from plant.servo import ServoModel

_FEWEST = 5  # least number of samples of a piece that is restarted
_ROUNDING = 1e-9  # of a window: tolerance for a sample at its end
SETTLE = 0.2  # seconds of the measured output from which a simulation estimates its initial state


def free_simulation(
    log: Log,
    model: ServoModel,
    *,
    window: float | None = None,
    settle: float = SETTLE,
    after: Callable[[int], None] | None = None,
) -> list[Array]:
    """Simulate every run from its command, with exact dry friction.

    Args:
        log: its measured output is used only in the first `settle` seconds of each run or window. If there are windows,
            an observer also brings the states that are not measured to each start, such as the twist of a shaft.
        model: the servo.
        window: length of the windows [s], each with a new initial state; None simulates each run in one piece.
        settle: length of measured output from which the initial angle and velocity are estimated [s].
        after: called after each run or window with its number of samples.

    Returns:
        One (T,) simulated output per run, in the unit of what the log measures.

    Raises:
        BadParameter: the window is not longer than `settle`, or the model's axis or unit of torque is not the log's.
    """
    if window is not None and not window > settle:
        raise BadParameter(f"The window is {window:g} s; it must be longer than the {settle:g} s that find its start.")
    if log.axis != model.axis:
        raise BadParameter(f"The log is of a {log.axis} axis, the model of a {model.axis} one.")
    same_unit(log, model)
    if log.response == "torque":
        inverse = InversePredictor(model=model, runs=log.runs, free=())
        found = inverse.predict(model.values, np.empty((len(log.runs), 0)), bandwidth=0.0, width=0.0)
        return [each.output for each in found]
    done = after or (lambda samples: None)
    return [_simulate_run(log, run, model, window, settle, done) for run in log.runs]


def _simulate_run(
    log: Log, run: Run, model: ServoModel, window: float | None, settle: float, done: Callable[[int], None]
) -> Array:
    elapsed = run.time - run.time[0]
    piece = np.floor(elapsed / (np.inf if window is None else window) + _ROUNDING).astype(int)
    starts = np.flatnonzero(np.diff(piece, prepend=-1))
    # A piece of a few samples is too short to estimate an initial state: it belongs to the piece before.
    starts = starts[np.diff(starts, append=len(run)) >= _FEWEST] if len(run) >= _FEWEST else starts[:1]
    starts[:1] = 0
    parts, end = [], None
    followed = _followed(log, run, model, settle) if len(starts) > 1 and len(model.states) > 2 else None
    for first, last in zip(starts, [*starts[1:], len(run)], strict=True):
        part = run.slice(int(first), int(last))
        begun = settling(part, settle)
        if not begun.valid.any():
            # No valid sample to restart from: continue from the end of the last piece.
            state = end if end is not None else np.zeros(2)
        else:
            there = None if followed is None or first == 0 else followed[:, first]
            state = starting_state(log, begun, model, there)
        # One sample more: the first one of the next piece.
        simulated, end = _from(log, run.slice(int(first), min(int(last) + 1, len(run))), model, state)
        parts.append(simulated[: len(part)])
        done(len(part))
    return np.concatenate(parts)


def settling(run: Run, settle: float) -> Run:
    """The first seconds of a run, at least two samples."""
    seen = int(np.searchsorted(run.time - run.time[0], settle * (1.0 + _ROUNDING), side="right"))
    return run.slice(0, max(seen, 2))


def _followed(log: Log, run: Run, model: ServoModel, settle: float) -> Array:
    """(n, T) states of an observer that follows a run."""
    predictor = Predictor(model=model, runs=(run,), free=(), substeps=steps_in_a_sample(model, log))
    start = starting_state(log, settling(run, settle), model)[None, :]
    bandwidth = HELD / log.sample_time
    return predictor.predict(model.values, start, bandwidth=bandwidth, width=0.0, sensitivities=False)[0].states


def _from(log: Log, run: Run, model: ServoModel, state: Array) -> tuple[Array, Array]:
    """Output (T,) from an initial state, (2,) or (n,), and the last angle and velocity (2,)."""
    predictor = Predictor(model=model, runs=(run,), free=(), substeps=steps_in_a_sample(model, log))
    free = predictor.predict(model.values, state[None, :], bandwidth=0.0, width=0.0, sensitivities=False)[0]
    return free.output, free.states[:2, -1]


def starting_state(log: Log, start: Run, model: ServoModel, there: Array | None = None) -> Array:
    """The initial state of a run, from a fit to a short stretch of its measured output.

    Angle and velocity are fitted. The other states are those of an observer, or settled. In the latter case they are
    fitted too if the stretch shows them: a load that is moving has wound its shaft up.

    Args:
        log: of the run.
        start: the stretch.
        model: the servo.
        there: (n,) states of an observer at the first sample, if there are earlier samples.

    Returns:
        (n,) angle and velocity, and the departures of the other states from where they would be settled.
    """
    predictor = Predictor(model=model, runs=(start,), free=(), substeps=steps_in_a_sample(model, log))
    begun = np.zeros(len(model.states))
    begun[:2] = first_states(replace(log, runs=(start,)))[0]
    if there is not None:
        begun[2:] = (there - predictor.settled(start, model.values, there[:2]))[2:]
    settled = _fitted(predictor, begun)
    free = replace(predictor, unsettled=True)
    hidden = len(free.fitted_starts) - len(predictor.fitted_starts)
    if there is not None or not hidden:
        return _with(begun, settled, predictor)
    unsettled, samples = _fitted(free, begun), int(start.valid.sum())
    gain = 0.5 * samples * np.log(max(settled.equations.cost, 1e-300) / max(unsettled.equations.cost, 1e-300))
    shown = gain > 0.5 * hidden * np.log(samples)  # Schwarz 1978
    return _with(begun, unsettled, free) if shown else _with(begun, settled, predictor)


def _fitted(predictor: Predictor, begun: Array) -> Minimum:
    """The fit of a free simulation by those numbers of an initial state (n,) that a predictor fits."""
    (start,) = predictor.runs
    places = list(predictor.fitted_starts)

    def linearise(point: Array, most: float) -> NormalEquations:
        state = begun.copy()
        state[places] = point
        here = predictor.predict(predictor.model.values, state[None, :], bandwidth=0.0, width=0.0)[0]
        return NormalEquations.of(here.innovations, here.jacobian)

    unbounded, samples = np.full(len(places), np.inf), int(start.valid.sum())
    return minimise(linearise, begun[places], -unbounded, unbounded, samples=samples, iterations=10)


def _with(begun: Array, fitted: Minimum, predictor: Predictor) -> Array:
    state = begun.copy()
    state[list(predictor.fitted_starts)] = fitted.point
    return state
