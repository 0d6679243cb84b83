"""The gain of an extended model on validation data. These may reject an effect, but no parameter is fitted to them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from diagnosis.jackknife import jackknife
from diagnosis.measured_motion import measurement_noise
from diagnosis.result import Findings, Gain, Replay, Unexplained
from identification.fit_result import Fit
from identification.log import Log, Run
from identification.simulation import free_simulation
from plant.effects.effect import Array
from plant.servo import ServoModel

_IRREGULAR, _MORE = 0.05, 3.0  # relative spread of the sample time; ratio of the noise floor to the measured noise
_HUGE = 1e50  # error in place of one that overflowed; its fourth power is still finite
_SAMPLES = 200  # least number of samples between restarts
_PIECES = 60  # largest number of windows in the longest run, at any sampling rate

STARTS = 0.2
"""Share of a window, or of a run without windows, from which the initial state is estimated, at most."""


def restart_window(log: Log) -> float:
    """Seconds between restarts of a simulation: the larger of 200 samples and a sixtieth of the longest run."""
    return max(_SAMPLES, max(map(len, log.runs)) / _PIECES) * log.sample_time


def scoring_window(*path: Fit) -> float | None:
    """Seconds between restarts of the scoring simulation of a path of models; None for whole runs.

    Without gravity or a position loop a servo integrates, so the error of a long simulation is drift. The simulation
    also restarts if a free simulation of the base model over its estimation runs is worse than a constant, or if an
    effect is chaotic.
    """
    log, model = path[0].log, path[0].model
    if log.response == "torque":  # nothing is simulated
        return None
    if any(fit.model.chaotic for fit in path):
        return restart_window(log)
    torque = np.concatenate([run.command for run in log.runs])
    holds = model.axis == "rotary" and abs(model.gravity) > 0.02 * float(np.sqrt(np.mean(torque**2)))
    if not (holds or any(run.positioned for run in log.runs)):
        return restart_window(log)
    spread = np.concatenate([(run.measured - run.measured[run.valid].mean())[run.valid] for run in log.runs])
    squares, _ = squared_errors(log, model, None, path[0].bandwidth)
    return None if float(np.mean(squares)) < float(np.mean(spread**2)) else restart_window(log)


def squared_errors(
    log: Log, model: ServoModel, window: float | None, bandwidth: float = np.inf
) -> tuple[Array, list[Array]]:
    """(T,) squared simulation errors of all valid samples, bounded in case of overflow, and the simulations.

    Args:
        log: of the validation data.
        model: the servo.
        window: seconds between restarts; None for whole runs.
        bandwidth: of the observer with which the model was fitted [rad/s], see `_start`.
    """
    simulated = list[Array]()
    for run in log.runs:
        settle = _start(log, run, bandwidth) if window is None else STARTS * window
        simulated += free_simulation(replace(log, runs=(run,)), model, window=window, settle=settle)
    errors = np.concatenate([(r.measured - s)[r.valid] for r, s in zip(log.runs, simulated, strict=True)])
    return bounded(errors) ** 2, simulated


def _start(log: Log, run: Run, bandwidth: float) -> float:
    """Seconds from which the initial state of a whole run is estimated: the memory of the model's observer.

    So long the model follows the motion. A short time would not do for a right model: over a long run, its error would
    be that of the initial velocity.
    """
    shortest = STARTS * restart_window(log)
    memory = 1.0 / bandwidth if bandwidth > 0.0 else np.inf
    return max(shortest, min(memory, STARTS * run.duration))


def bounded(errors: Array) -> Array:
    """Errors (T,) clipped so that their squares and the variance of these are finite after an overflow."""
    return np.asarray(np.nan_to_num(np.clip(errors, -_HUGE, _HUGE), nan=_HUGE))


def rms(errors: Array) -> tuple[float, float]:
    """Root mean square of a record (T,) and its standard error, from the scatter over blocks of the record."""
    squares = bounded(errors) ** 2
    return float(np.sqrt(np.mean(squares))), jackknife(np.sqrt, squares)


def cut(before: Array, after: Array) -> tuple[float, float]:
    """Relative reduction of a root mean square, from the squares (T,) before and after, and its standard error [-]."""

    def share(was: float, still: float) -> float:
        return 1.0 - float(np.sqrt(still / was)) if was > 0.0 else 0.0

    return share(float(np.mean(before)), float(np.mean(after))), jackknife(share, before, after)


def measure_gain(held_out: Log, path: list[Fit]) -> tuple[Gain, list[Array], tuple[Replay, ...]]:
    """Gain of the last fit of a path over the first, the squared errors after each step, and the runs replayed."""
    window = scoring_window(*path)
    scored = [squared_errors(held_out, fit.model, window, fit.bandwidth) for fit in path]
    squares = [square for square, _ in scored]
    gain = Gain(
        held_out_rms_before=float(np.sqrt(np.mean(squares[0]))),
        held_out_rms_after=float(np.sqrt(np.mean(squares[-1]))),
        noise_floor=path[-1].noise_floor,
        floor_name=_floor_name(path[-1]),
        unit=held_out.measured_unit,
        window=window,
        runs=tuple(run.label for run in held_out.runs),
    )
    replays = tuple(
        Replay(label=run.label, time=run.time, measured=run.measured, before=before, after=after, valid=run.valid)
        for run, before, after in zip(held_out.runs, scored[0][1], scored[-1][1], strict=True)
    )
    return gain, squares, replays


def _floor_name(fit: Fit) -> str:
    """Name of the least error of a fit: a noise floor only with regular sampling and about the measured noise."""
    if fit.log.response == "torque":
        return "error on the estimation data"
    noise = max(measurement_noise(run) for run in fit.log.runs)
    irregular = any(np.diff(run.time).std() > _IRREGULAR * run.sample_time for run in fit.log.runs)
    return "one-step error" if irregular or fit.noise_floor > _MORE * noise else "noise floor"


def remaining(gain: Gain, depends_on: tuple[str, ...]) -> Unexplained:
    """Share of the validation error power above the noise floor that remains with the extended model."""
    share = _share(gain.held_out_rms_before**2, gain.held_out_rms_after**2, gain.noise_floor**2)
    return Unexplained(share=share, depends_on=depends_on)


def _share(before: float, after: float, floor: float) -> float:
    return float(np.clip((after - floor) / (before - floor), 0.0, 1.0)) if before > floor else 0.0


@dataclass(frozen=True, kw_only=True)
class GainErrors:
    """Standard errors of the results of a diagnosis on validation data.

    Attributes:
        before, after: of the root mean squares with the base and the extended model [rad or m].
        cut: of the relative reduction of the error [-].
        noise_floor: of the measurement noise that the extended model leaves [rad or m].
        share: of the error power above the noise floor that remains [-].
    """

    before: float
    after: float
    cut: float
    noise_floor: float
    share: float


def gain_errors(found: Findings) -> GainErrors:
    """Standard errors of the gain of a diagnosis, from the errors on its validation runs."""
    before, after = (
        bounded(np.concatenate([(run.measured - path)[run.valid] for run, path in simulated])) ** 2
        for simulated in ([(r, r.before) for r in found.replays], [(r, r.after) for r in found.replays])
    )
    floor = found.gain.noise_floor
    return GainErrors(
        before=jackknife(np.sqrt, before),
        after=jackknife(np.sqrt, after),
        cut=cut(before, after)[1],
        noise_floor=floor / np.sqrt(2.0 * found.extended.samples),
        share=jackknife(lambda was, still: _share(was, still, floor**2), before, after),
    )
