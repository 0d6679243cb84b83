"""The search for a torque signal that distinguishes two models: over grids of families, then near the best signal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.experiment.reshaping import rearranged, reshaped
from diagnosis.experiment.separation import CompetingModel, Separation, Trial
from diagnosis.experiment.signal_families import Signal, shapes
from diagnosis.experiment.time_scale import time_scale
from identification.log import Log
from plant.effects.effect import Array
from plant.errors import BadParameter

_LADDER = (1.0, 0.6, 0.35, 0.2, 0.1, 0.05)  # amplitudes to try, as shares of the torque limit less the bias
_TRIES = 200  # changes of the best signal, fewer if a simulation takes more steps per sample
_LARGE, _SMALL = 0.2, 0.005  # initial and least size of a change, as shares of the torque limit
_PLAIN = (0.1, 5.0)  # Hz at 5 ms, start and stop of the plain chirp


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of a machine: command torque [N m], speed [rad/s], lower and upper end of travel [rad].

    Raises:
        BadParameter: a limit is not positive, or the travel is empty.
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

    @classmethod
    def of(cls, log: Log) -> Limits:
        """The torque, speed and travel that occur in a log."""
        speeds = np.concatenate([np.abs(np.gradient(run.output, run.time)[run.valid]) for run in log.runs])
        outputs = np.concatenate([run.output[run.valid] for run in log.runs])
        return cls(
            torque=max(float(np.max(np.abs(run.command))) for run in log.runs),
            speed=float(np.quantile(speeds, 0.999)),
            travel=(float(outputs.min()), float(outputs.max())),
        )

    def hold(self, trial: Trial) -> bool:
        """Whether both models stay within speed and travel."""
        within = self.travel[0] <= trial.travel[0] and trial.travel[1] <= self.travel[1]
        return within and trial.speed <= self.speed


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """A signal (T,) that keeps the limits, with its separation to first order and its log odds.

    The log odds are those to first order, or after a full refit; `weakest` is from `Trial.settled`.
    """

    signal: Signal
    torque: Array
    trial: Trial
    separation: Separation
    log_odds: float
    weakest: tuple[int, ...] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Design:
    """The design problem: two models, the limits and the duration."""

    competing: tuple[CompetingModel, CompetingModel]
    limits: Limits
    duration: float
    sample_time: float
    start: float

    def attempt(self, signal: Signal) -> Found | None:
        """Simulate a signal and calculate its separation to first order; None if it exceeds a limit."""
        signal = signal.playable(self.sample_time)
        return self.tried(signal, signal.torque(self.duration, self.sample_time))

    def tried(self, signal: Signal, torque: Array) -> Found | None:
        """The same for a torque (T,) that has been derived from a signal."""
        if np.abs(torque).max() > self.limits.torque * (1.0 + 1e-12):
            return None
        trial = self.play(torque)
        if not self.limits.hold(trial):
            return None
        separation = trial.first_order(self.start)
        return Found(signal=signal, torque=torque, trial=trial, separation=separation, log_odds=separation.log_odds)

    @property
    def effort(self) -> int:
        """Cost of one simulation: its integration steps per sample."""
        return max(each.substeps for each in self.competing)

    def play(self, torque: Array) -> Trial:
        """Simulate the torque with both models."""
        return Trial.play(self.competing, torque, sample_time=self.sample_time, start=self.start)

    def coarse(self) -> Iterator[Found]:
        """All families on their grids, at the amplitudes of the ladder that keep the limits."""
        for bias in sorted({0.0, self.holding_torque()}):
            room = self.limits.torque - abs(bias)
            for shape in shapes(bias, time_scale(self.sample_time)):
                for share in _LADDER[:: min(self.effort, 3)]:
                    found = self.attempt(replace(shape, amplitude=share * room))
                    if found is not None:
                        yield found

    def refined(self, found: Found, rng: np.random.Generator) -> Found:
        """Refine a signal by many small random changes (Rechenberg 1973, (1+1) evolution strategy).

        Half of them on average rearrange the signal. The success of the others controls the size of the next change.
        """
        best, size = found, _LARGE
        for _ in range(max(_TRIES // self.effort, 5)):
            moves = rng.random() < 0.5
            torque = rearranged(best.torque, rng) if moves else reshaped(best.torque, size * self.limits.torque, rng)
            near = self.tried(best.signal, np.clip(torque, -self.limits.torque, self.limits.torque))
            if near is not None:
                near = self.settled(near, above=best.log_odds, weakest=best.weakest)
            if near is not None and near.log_odds > best.log_odds:
                best, size = near, size if moves else min(1.5 * size, 1.0)
            elif not moves:
                size = max(0.93 * size, _SMALL)
        return best

    def settled(self, found: Found, *, above: float = 0.0, weakest: tuple[int, ...] | None = None) -> Found:
        """The same signal with its log odds after full refits; these stop if the log odds cannot exceed `above`."""
        log_odds, places = found.trial.settled(self.start, above=above, weakest=weakest)
        return replace(found, log_odds=log_odds, weakest=places)

    def best(self, seed: int) -> Found:
        """The best signal: the best of all families, refined."""
        return self.refined(self.leaders()[0], np.random.default_rng(seed))

    def leaders(self) -> list[Found]:
        """The best of each family to first order, ranked by their log odds after a full refit."""
        return sorted(map(self.settled, self.promising()), key=_log_odds, reverse=True)

    def promising(self) -> list[Found]:
        """The best of each family to first order.

        Raises:
            BadParameter: no signal keeps the limits.
        """
        leaders: dict[str, Found] = {}
        for found in self.coarse():
            kept = leaders.get(found.signal.family)
            if kept is None or found.separation.log_odds > kept.separation.log_odds:
                leaders[found.signal.family] = found
        if not leaders:
            raise BadParameter(
                f"No signal keeps the machine within a speed of {self.limits.speed:g} and a travel from "
                f"{self.limits.travel[0]:g} to {self.limits.travel[1]:g} when it starts at rest at {self.start:.3g}: "
                "give it more room, or begin where it rests."
            )
        return list(leaders.values())

    def plain_chirp(self) -> Found | None:
        """The plain chirp with the highest log odds; None if none keeps the limits."""
        best: Found | None = None
        for found in self.chirps():
            judged = self.settled(found, above=best.log_odds if best else 0.0)
            best = max(best or judged, judged, key=_log_odds)
        return best

    def chirps(self) -> Iterator[Found]:
        """Plain chirps with and without a bias, at all amplitudes that keep the limits."""
        numbers = dict(zip(("start", "stop"), _PLAIN, strict=True))
        for bias in sorted({0.0, self.holding_torque()}):
            for share in np.geomspace(1.0, 0.05, 10):
                amplitude = float(share) * (self.limits.torque - abs(bias))
                plain = Signal(family="chirp", amplitude=amplitude, bias=bias, numbers=numbers)
                found = self.attempt(plain.slower(time_scale(self.sample_time)))
                if found is not None:
                    yield found

    def settle(self, signals: Iterable[Found], enough: float) -> bool:
        """Whether any of the signals has log odds above `enough`."""
        return any(self.settled(found, above=enough).log_odds > enough for found in signals)

    def holding_torque(self) -> float:
        """The constant torque that holds the load at the start; zero if the torque limit is too small or it is tiny."""
        count = max(2, round(min(self.duration, 0.5 * time_scale(self.sample_time)) / self.sample_time))

        def moved(torque: float) -> float:
            trial = self.play(np.full(count, torque))
            return sum(trial.travel) - 2.0 * self.start

        edges = []
        for side in (-1.0, 1.0):  # below the first edge the load moves back, above the second it moves forward
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


def _log_odds(found: Found) -> float:
    return found.log_odds
