"""The separating experiment: the torque signal within a machine's limits that best distinguishes two models."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from diagnosis.experiment.separation import CompetingModel
from diagnosis.experiment.signal_design import Design, Found, Limits
from diagnosis.experiment.signal_families import Signal
from diagnosis.experiment.time_scale import time_scale
from diagnosis.levels import SURE
from diagnosis.result import Findings
from identification.fit_result import Fit
from plant.effects.effect import Array, Axis
from plant.errors import BadParameter
from plant.file_format import check_format
from plant.result_display import Drawn

__all__ = ["Experiment", "Limits", "competing_fits", "separating_experiment"]

_DURATIONS = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0)  # tried by default, at 5 ms [s]
_CONVINCING = 5.0  # least expected log odds of a useful experiment
_TRIALS = 12  # approximate number of durations that are tried
_SETTLED = 9.3  # mean m of log odds, of standard deviation sqrt(2 m), that exceed log(SURE / (1 - SURE)) in 95 of 100


@dataclass(frozen=True, kw_only=True, eq=False)
class Experiment(Drawn):
    """A torque signal that distinguishes two competing models.

    Attributes:
        competing: for each model, names of the effects that the other does not have.
        time: (T,) [s].
        torque: (T,) command, held over each sample [N m; N].
        start: angle of rest at the start of the experiment [rad; m].
        signal: the family and its parameters.
        separation: expected difference of the log-likelihoods after the experiment, with the wrong model refitted; the
            smaller value of the two cases.
        absorbed: share of the difference between the models' outputs that the refit absorbs [-].
        chirp_separation, chirp_absorbed: the same for a plain chirp of the same duration within the same limits, with
            the best of its amplitudes.
        chirp_duration: duration of a plain chirp that decides [s]; infinite if it exceeds the longest tried.
        predictions: (T,) predicted measurement of each model [rad; m].
        axis: "rotary" or "linear".
    """

    competing: tuple[str, str]
    time: Array
    torque: Array
    start: float
    signal: Signal
    separation: float
    absorbed: float
    chirp_separation: float
    chirp_absorbed: float
    chirp_duration: float
    predictions: tuple[Array, Array]
    axis: Axis

    @property
    def separable(self) -> bool:
        """Whether the experiment is expected to decide between the models."""
        return self.separation >= _CONVINCING

    @property
    def sample_time(self) -> float:
        """Time for which each torque is held [s]."""
        return float(self.time[1] - self.time[0])

    @property
    def duration(self) -> float:
        """Of the whole signal [s]."""
        return self.time.size * self.sample_time

    def write(self, path: str | Path) -> None:
        """Write the signal as CSV: time [s] and torque [N m] (force [N] on a linear axis), one row for each sample.

        Raises:
            BadParameter: the suffix is not .csv.
        """
        check_format(Path(path), (".csv",))
        name = "torque" if self.axis == "rotary" else "force"
        table = np.column_stack((self.time, self.torque))
        np.savetxt(path, table, fmt="%.10g", delimiter=",", header=f"time,{name}", comments="")

    def to_dict(self, file: str = "separating_experiment.csv") -> dict[str, Any]:
        """Its entry in diagnosis.json."""
        return {
            "rivals": list(self.competing),
            "duration": self.duration,
            "sample_time": self.sample_time,
            "start": self.start,
            "signal": str(self.signal),
            "expected_log_odds": self.separation,
            "chirp_log_odds": self.chirp_separation,
            "chirp_duration": self.chirp_duration if np.isfinite(self.chirp_duration) else None,
            "file": file,
        }

    def __repr__(self) -> str:
        """The competing effects, the signal and its duration in one line."""
        first, second = self.competing
        return f"Experiment({first} against {second}: {self.signal}, {self.duration:.3g} s)"

    def __str__(self) -> str:
        """The signal and its expected log-likelihood difference."""
        first, second = self.competing
        if not self.separable:
            return (
                f"No signal of {self.duration:.3g} s within the limits distinguishes {first} from {second}. The "
                f"best, {self.signal}, has an expected log-likelihood difference of {self.separation:.2g}."
            )
        longest = f"more than {durations(self.sample_time)[-1]:.3g} s"
        chirp = f"{self.chirp_duration:.3g} s" if np.isfinite(self.chirp_duration) else longest
        return (
            f"Apply {self.signal}, reshaped, for {self.duration:.3g} s to distinguish {first} from {second}. The "
            f"expected log-likelihood difference is {self.separation:.3g}; a plain chirp of that length has "
            f"{self.chirp_separation:.3g}, and would need {chirp}."
        )


def separating_experiment(
    first: Fit,
    second: Fit,
    limits: Limits,
    *,
    duration: float | None = None,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Experiment:
    """Design the torque signal that best distinguishes two models fitted to one log.

    The experiment starts at rest at the initial angle of the log's first run, and has the log's sample time.

    Args:
        first, second: the competing models, fitted to the same log.
        limits: of the machine; both models keep them in simulation.
        duration: of the experiment [s]; by default the shortest that is expected to decide, at most 32 s, or 6,400
            samples of more than 5 ms.
        seed: of the random changes of the best signal.
        progress: called with a line of text for each duration that is tried.

    Raises:
        BadParameter: the log is of a position servo, of the velocity alone or of an inverse model, or no signal keeps
            the limits.
    """
    if any(run.positioned for run in first.log.runs):
        raise BadParameter(
            "The experiment is a torque, and this log is of a position servo. Choose set-points by hand."
        )
    if first.log.response == "torque":
        raise BadParameter(
            "The experiment is a torque command, but in this log the torque follows the motion; move this axis alone, "
            "slowly and fast, in both directions."
        )
    if first.log.response == "velocity":
        raise BadParameter(
            "The experiment is planned by the angle, and this log has only the velocity. Log the angle too."
        )
    start, sample_time = float(first.initial[0, 0]), first.log.sample_time
    if not limits.travel[0] <= start <= limits.travel[1]:
        least, most = limits.travel
        raise BadParameter(
            f"The log begins at {start:.3g}, outside of the travel from {least:g} to {most:g}: widen the travel."
        )
    if duration is not None and not (np.isfinite(duration) and duration >= 10.0 * sample_time):
        raise BadParameter(f"duration = {duration:g} s must be at least ten samples of {sample_time:g} s.")
    competing, tried = (CompetingModel.of(first), CompetingModel.of(second)), count()

    def lasting(length: float) -> Design:
        if progress is not None:
            progress(f"signals of {length:g} s, {next(tried)} of {_TRIALS} durations are tried")
        return Design(competing=competing, limits=limits, duration=length, sample_time=sample_time, start=start)

    ladder = durations(sample_time)
    best = _shortest(lasting, ladder, seed) if duration is None else lasting(duration).best(seed)
    chirp = lasting(best.torque.size * sample_time).plain_chirp()
    return Experiment(
        competing=_names(first, second),
        time=np.arange(best.torque.size, dtype=float) * sample_time,
        torque=best.torque,
        start=start,
        signal=best.signal,
        separation=best.log_odds,
        absorbed=best.separation.absorbed,
        chirp_separation=chirp.log_odds if chirp else 0.0,
        chirp_absorbed=chirp.separation.absorbed if chirp else 1.0,
        chirp_duration=_chirp_duration(lasting, ladder),
        predictions=(best.trial.runs[0].output, best.trial.runs[1].output),
        axis=first.model.axis,
    )


def durations(sample_time: float) -> tuple[float, ...]:
    """Durations that are tried by default [s]."""
    return tuple(length * time_scale(sample_time) for length in _DURATIONS)


def _shortest(lasting: Callable[[float], Design], ladder: tuple[float, ...], seed: int) -> Found:
    """The best signal of the shortest duration that decides; the two next shorter ones are tried with refinement."""

    def settled(length: float) -> bool:
        design = lasting(length)
        return design.settle(design.promising(), _SETTLED)

    place = bisect_left(ladder[:-1], True, key=settled)
    for length in ladder[max(place - 2, 0) : place]:
        best = lasting(length).best(seed)
        if best.log_odds >= _SETTLED:
            return best
    return lasting(ladder[place]).best(seed)


def _chirp_duration(lasting: Callable[[float], Design], ladder: tuple[float, ...]) -> float:
    """The shortest duration of a plain chirp that decides [s]; infinite without one."""

    def settled(length: float) -> bool:
        design = lasting(length)
        return design.settle(design.chirps(), _SETTLED)

    place = bisect_left(ladder, True, key=settled)
    return ladder[place] if place < len(ladder) else np.inf


def _names(first: Fit, second: Fit) -> tuple[str, str]:
    """For each of two models, the effects that the other does not have."""
    mine, theirs = ([effect.name for effect in fit.model.effects] for fit in (first, second))

    def only(own: list[str], other: list[str]) -> str:
        return " and ".join(name for name in own if name not in other) or "nothing more"

    return only(mine, theirs), only(theirs, mine)


def competing_fits(diagnosis: Findings) -> tuple[Fit, Fit] | None:
    """The fits of the most probable sets with and without the first uncertain cause; None without one.

    Also None if the set without the cause has no competing effect: then no signal is better than a longer log.
    """
    fitted = [(set(each.effects), each.fit) for each in diagnosis.sets if each.fit is not None]
    for cause in diagnosis.causes:
        holder = next((pair for pair in fitted if cause.effect in pair[0]), None)
        other = next((pair for pair in fitted if cause.effect not in pair[0]), None)
        if cause.probability <= SURE and holder is not None and other is not None and not other[0] <= holder[0]:
            return holder[1], other[1]
    return None
