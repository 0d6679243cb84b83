"""The separating experiment: the torque signal within a machine's limits that best tells two explanations apart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from diagnosis.odds import CLEAR
from diagnosis.result import Diagnosis
from diagnosis.separation import Rival, Separation, Trial
from diagnosis.signal_families import Signal, shapes
from identification.fit_result import Fit
from identification.problem import Problem
from plant.effects import catalogue
from plant.effects.effect import Array, Axis
from plant.errors import BadParameter

_DURATION = 10.0  # of an experiment about which nothing else is said [s]
_LADDER = (1.0, 0.6, 0.35, 0.2, 0.1, 0.05)  # amplitudes to try, as shares of what the torque limit leaves
_FINALISTS = 4  # signals of different families that are refined
_NEIGHBOURS = 25  # tried around each of them
_PROMISING = 0.8  # share of the worth to first order from which a neighbour is judged by a full refit
_CONVINCING = 5.0  # expected difference of the log-likelihood from which an experiment is worth its time
_PLAIN = (0.1, 5.0)  # Hz, the chirp that an experimenter would play first


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a machine may do: torque of the command [N m], speed [rad/s], travel from and to [rad].

    Raises:
        BadParameter: a limit leaves no room.
    """

    torque: float
    speed: float = np.inf
    travel: tuple[float, float] = (-np.inf, np.inf)

    def __post_init__(self) -> None:
        """Validate."""
        if not (np.isfinite(self.torque) and self.torque > 0.0):
            raise BadParameter(f"Limits: the torque limit must be a positive number, not {self.torque:g}.")
        if not self.speed > 0.0:
            raise BadParameter(f"Limits: the speed limit must be positive, not {self.speed:g}.")
        least, most = self.travel
        if not least < most:
            raise BadParameter(f"Limits: the travel must go from a lower to a higher angle, not {least:g} to {most:g}.")

    def hold(self, trial: Trial) -> bool:
        """Whether both rivals stay within speed and travel."""
        within = self.travel[0] <= trial.travel[0] and trial.travel[1] <= self.travel[1]
        return within and trial.speed <= self.speed


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


@dataclass(frozen=True, kw_only=True, eq=False)
class _Found:
    """A signal that keeps the limits, and what it is worth."""

    signal: Signal
    torque: Array
    trial: Trial
    worth: Separation


@dataclass(frozen=True, kw_only=True, eq=False)
class _Design:
    """The task: two rivals, limits, and how long."""

    rivals: tuple[Rival, Rival]
    limits: Limits
    duration: float
    sample_time: float
    start: float

    def attempt(self, signal: Signal) -> _Found | None:
        """What a signal is worth to first order, None where it breaks a limit."""
        signal = signal.playable(self.sample_time)
        torque = signal.torque(self.duration, self.sample_time)
        if np.abs(torque).max() > self.limits.torque * (1.0 + 1e-12):
            return None
        trial = self.play(torque)
        if not self.limits.hold(trial):
            return None
        worth = trial.separation(start=self.start)
        return _Found(signal=signal, torque=torque, trial=trial, worth=worth)

    def play(self, torque: Array) -> Trial:
        """The torque in both rivals."""
        return Trial.play(self.rivals, torque, sample_time=self.sample_time, start=self.start)

    def coarse(self) -> Iterator[_Found]:
        """All families on their grids, at every amplitude of the ladder that keeps the limits."""
        for bias in sorted({0.0, self.holding_torque()}):
            room = self.limits.torque - abs(bias)
            for shape in shapes(bias):
                for share in _LADDER:
                    found = self.attempt(replace(shape, amplitude=share * room))
                    if found is not None:
                        yield found

    def refined(self, found: _Found, rng: np.random.Generator) -> _Found:
        """The best of a random walk around a signal; first order picks the steps, a full refit judges them."""
        here, judged = found, self.settled(found)
        for _ in range(_NEIGHBOURS):
            near = self.attempt(here.signal.varied(rng, self.limits.torque))
            if near is None or near.worth.log_odds <= _PROMISING * here.worth.log_odds:
                continue
            settled = self.settled(near)
            if settled.worth.log_odds > judged.worth.log_odds:
                here, judged = near, settled
        return judged

    def settled(self, found: _Found) -> _Found:
        """The same signal, judged by a full refit of the rivals."""
        return replace(found, worth=found.trial.separation(start=self.start, refitted=True))

    def plain_chirp(self) -> Separation:
        """What a plain chirp at the largest amplitude that keeps the limits is worth."""
        numbers = dict(zip(("start", "stop"), _PLAIN, strict=True))
        best = Separation(log_odds=0.0, absorbed=1.0)
        for bias in sorted({0.0, self.holding_torque()}):
            for share in np.geomspace(1.0, 0.02, 12):
                amplitude = float(share) * (self.limits.torque - abs(bias))
                signal = Signal(family="chirp", amplitude=amplitude, bias=bias, numbers=numbers)
                found = self.attempt(signal)
                if found is not None:
                    best = max(best, self.settled(found).worth, key=lambda worth: worth.log_odds)
                    break
        return best

    def holding_torque(self) -> float:
        """The constant torque that holds the machine where it begins, zero where the limit is too small for it."""
        count = max(2, round(min(self.duration, 0.5) / self.sample_time))

        def moved(torque: float) -> float:
            trial = self.play(np.full(count, torque))
            return sum(trial.travel) - 2.0 * self.start

        edges = []
        for side in (-1.0, 1.0):  # below the first edge it falls back, above the second it moves on
            low, high = -self.limits.torque, self.limits.torque
            if moved(low) >= 0.0 or moved(high) <= 0.0:
                return 0.0
            for _ in range(20):
                middle = 0.5 * (low + high)
                way = moved(middle)
                low, high = (middle, high) if way < 0.0 or (way == 0.0 and side > 0.0) else (low, middle)
            edges.append(low)
        hold = 0.5 * sum(edges)
        return hold if abs(hold) > 1e-3 * self.limits.torque else 0.0


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
    design = _Design(rivals=rivals, limits=limits, duration=length, sample_time=sample_time, start=start)
    best = _search(design, seed)
    chirp = design.plain_chirp()
    return Experiment(
        rivals=_names(first, second),
        time=np.arange(best.torque.size, dtype=float) * sample_time,
        torque=best.torque,
        start=start,
        signal=best.signal,
        separation=best.worth.log_odds,
        absorbed=best.worth.absorbed,
        chirp_separation=chirp.log_odds,
        chirp_absorbed=chirp.absorbed,
        predictions=(best.trial.runs[0].output, best.trial.runs[1].output),
        axis=first.model.axis,
    )


def _search(design: _Design, seed: int) -> _Found:
    leaders: dict[str, _Found] = {}
    for found in design.coarse():
        kept = leaders.get(found.signal.family)
        if kept is None or found.worth.log_odds > kept.worth.log_odds:
            leaders[found.signal.family] = found
    if not leaders:
        raise BadParameter(
            f"No signal keeps the machine within a speed of {design.limits.speed:g} and a travel from "
            f"{design.limits.travel[0]:g} to {design.limits.travel[1]:g} when it starts at rest at {design.start:.3g}: "
            "give it more room, or begin where it rests."
        )
    rng = np.random.default_rng(seed)
    finalists = sorted(leaders.values(), key=lambda found: -found.worth.log_odds)[:_FINALISTS]
    return max((design.refined(found, rng) for found in finalists), key=lambda found: found.worth.log_odds)


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
        fixed = [p.name for p in fit.parameters if p.fixed and p.name in model.names]
        return fit, Problem.of(fit.log, model, fixed=fixed).descend(fit)
    return None
