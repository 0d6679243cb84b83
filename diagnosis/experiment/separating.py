"""The separating experiment: the torque signal within a machine's limits that best tells two explanations apart."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from diagnosis.experiment.separation import Rival
from diagnosis.experiment.signal_design import Design, Limits
from diagnosis.experiment.signal_families import Signal
from diagnosis.odds import CLEAR
from diagnosis.result import Diagnosis
from identification.fit_result import Fit
from identification.problem import Problem
from plant.effects import catalogue
from plant.effects.effect import Array, Axis
from plant.errors import BadParameter

__all__ = ["Experiment", "Limits", "rivals_of", "separating_experiment"]

_DURATION = 10.0  # of an experiment about which nothing else is said [s]
_WIDE = 30.0  # bandwidth of the observer from which a rival's refit descends [rad/s]
_CONVINCING = 5.0  # expected log odds from which an experiment is worth its time


@dataclass(frozen=True, kw_only=True, eq=False)
class Experiment:
    """A torque signal that tells two rivals apart.

    Attributes:
        rivals: names of what one has and the other has not.
        time: (T,) [s].
        torque: (T,) command, held over each sample [N m; N].
        start: angle at which the machine is at rest when it begins [rad; m].
        signal: the family and its numbers.
        separation: expected difference of the log-likelihoods after the experiment, when the wrong rival has been
            refitted; the lesser of the two cases of who is right.
        absorbed: share of the difference between the rivals' outputs that the refit takes away [-].
        chirp_separation, chirp_absorbed: the same for a plain chirp of the same duration within the same limits.
        predictions: (T,) what the sensor shows under either rival [rad; m].
        axis: "rotary" or "linear".
    """

    rivals: tuple[str, str]
    time: Array
    torque: Array
    start: float
    signal: Signal
    separation: float
    absorbed: float
    chirp_separation: float
    chirp_absorbed: float
    predictions: tuple[Array, Array]
    axis: Axis

    @property
    def separable(self) -> bool:
        """Whether the experiment can be expected to settle it."""
        return self.separation >= _CONVINCING

    @property
    def sample_time(self) -> float:
        """How long each torque is held [s]."""
        return float(self.time[1] - self.time[0])

    @property
    def duration(self) -> float:
        """Of the whole signal [s]."""
        return self.time.size * self.sample_time

    def write(self, path: str | Path) -> None:
        """Write the signal as CSV: time [s] and torque [N m] (force [N] on a linear axis), one row for each sample."""
        name = "torque" if self.axis == "rotary" else "force"
        table = np.column_stack((self.time, self.torque))
        np.savetxt(path, table, fmt="%.10g", delimiter=",", header=f"time,{name}", comments="")

    def to_dict(self, file: str = "separating_experiment.csv") -> dict[str, Any]:
        """Its entry in diagnosis.json."""
        return {
            "rivals": list(self.rivals),
            "duration": self.duration,
            "sample_time": self.sample_time,
            "start": self.start,
            "signal": str(self.signal),
            "expected_log_odds": self.separation,
            "chirp_log_odds": self.chirp_separation,
            "file": file,
        }

    def __str__(self) -> str:
        """What it is and what may be hoped of it."""
        first, second = self.rivals
        if not self.separable:
            return (
                f"No signal of {self.duration:.3g} s within the limits tells {first} from {second}: the best, "
                f"{self.signal}, is worth a log-likelihood difference of {self.separation:.2g}."
            )
        return (
            f"Play {self.signal} for {self.duration:.3g} s to tell {first} from {second}: expected log-likelihood "
            f"difference {self.separation:.3g}, against {self.chirp_separation:.3g} for a chirp as long."
        )


def separating_experiment(
    first: Fit, second: Fit, limits: Limits, *, duration: float | None = None, seed: int = 0
) -> Experiment:
    """Design the torque signal that best tells two fitted models of one log apart.

    It begins at rest at the angle at which the log's first run began, at the log's sample time.

    Args:
        first, second: the rivals, fitted to the same log.
        limits: of the machine; both rivals keep them in simulation.
        duration: of the experiment [s]; 10 s by default.
        seed: of the local search around the best signals.

    Raises:
        BadParameter: the log is of a position servo, or no signal keeps the limits.
    """
    if any(np.any(run.servo_gain) for run in first.log.runs):
        raise BadParameter("This log is of a position servo, which plays no torque: design its goal by hand.")
    start, sample_time = float(first.initial[0, 0]), first.log.sample_time
    if not limits.travel[0] <= start <= limits.travel[1]:
        least, most = limits.travel
        raise BadParameter(
            f"The log begins at {start:.3g}, outside of the travel from {least:g} to {most:g}: widen the travel."
        )
    length = _DURATION if duration is None else duration
    if not (np.isfinite(length) and length >= 10.0 * sample_time):
        raise BadParameter(f"duration = {length:g} s must be at least ten samples of {sample_time:g} s.")
    rivals = (Rival.of(first), Rival.of(second))
    design = Design(rivals=rivals, limits=limits, duration=length, sample_time=sample_time, start=start)
    best, chirp = design.best(seed), design.plain_chirp()
    return Experiment(
        rivals=_names(first, second),
        time=np.arange(best.torque.size, dtype=float) * sample_time,
        torque=best.torque,
        start=start,
        signal=best.signal,
        separation=best.log_odds,
        absorbed=best.worth.absorbed,
        chirp_separation=chirp.log_odds if chirp else 0.0,
        chirp_absorbed=chirp.worth.absorbed if chirp else 1.0,
        predictions=(best.trial.runs[0].output, best.trial.runs[1].output),
        axis=first.model.axis,
    )


def _names(first: Fit, second: Fit) -> tuple[str, str]:
    """What each of two models has and the other has not."""
    mine, theirs = ([effect.name for effect in fit.model.effects] for fit in (first, second))

    def only(own: list[str], other: list[str]) -> str:
        return " and ".join(name for name in own if name not in other) or "nothing more"

    return only(mine, theirs), only(theirs, mine)


def rivals_of(diagnosis: Diagnosis) -> tuple[Fit, Fit] | None:
    """The extended model and the best alternative to its first ambiguous cause, both fitted; None if there is none."""
    for cause in diagnosis.causes:
        others = [name for name, _ in cause.alternatives if name in catalogue]
        if cause.probability >= CLEAR or not others:
            continue
        tried = [c for c in diagnosis.candidates if c.effect == others[0] and c.refitted and c.parameters]
        if not tried:
            continue
        best = max(tried, key=lambda candidate: candidate.evidence)
        values = {name: estimate.value for name, estimate in best.parameters.items()}
        fit = diagnosis.extended
        model = fit.model.without_effect(cause.effect).with_effect(catalogue[others[0]](**values))
        fixed = [name for name in fit.fixed if name in model.names]
        # A descent only ever lowers the bandwidth, and a rival may need one where the leader needs none.
        start = replace(fit, bandwidth=max(fit.bandwidth, _WIDE))
        return fit, Problem.of(fit.log, model, fixed=fixed).descend(start)
    return None
