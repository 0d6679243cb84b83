"""The search for a torque signal that tells two rivals apart: coarse over families of signals, then around the best."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.experiment.separation import Rival, Separation, Trial
from diagnosis.experiment.signal_families import Signal, shapes
from identification.log import Log
from plant.effects.effect import Array
from plant.errors import BadParameter

_LADDER = (1.0, 0.6, 0.35, 0.2, 0.1, 0.05)  # amplitudes to try, as shares of what the torque limit leaves
_FINALISTS = 2  # signals of different families that are refined
_NEIGHBOURS = 40  # tried around each of them, fewer where a simulation takes finer steps
_PROMISING = 0.8  # share of the worth to first order from which a neighbour is judged by a full refit
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

    @classmethod
    def of(cls, log: Log) -> Limits:
        """What the machine has shown in a log that it can do."""
        speeds = np.concatenate([np.abs(np.gradient(run.output, run.time)[run.valid]) for run in log.runs])
        outputs = np.concatenate([run.output[run.valid] for run in log.runs])
        return cls(
            torque=max(float(np.max(np.abs(run.command))) for run in log.runs),
            speed=float(np.quantile(speeds, 0.999)),
            travel=(float(outputs.min()), float(outputs.max())),
        )

    def hold(self, trial: Trial) -> bool:
        """Whether both rivals stay within speed and travel."""
        within = self.travel[0] <= trial.travel[0] and trial.travel[1] <= self.travel[1]
        return within and trial.speed <= self.speed


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """A signal (T,) that keeps the limits: what it is worth to first order, and its log odds after a full refit."""

    signal: Signal
    torque: Array
    trial: Trial
    worth: Separation
    log_odds: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Design:
    """The task: two rivals, limits, and how long."""

    rivals: tuple[Rival, Rival]
    limits: Limits
    duration: float
    sample_time: float
    start: float

    def attempt(self, signal: Signal) -> Found | None:
        """What a signal is worth to first order, None where it breaks a limit."""
        signal = signal.playable(self.sample_time)
        torque = signal.torque(self.duration, self.sample_time)
        if np.abs(torque).max() > self.limits.torque * (1.0 + 1e-12):
            return None
        trial = self.play(torque)
        if not self.limits.hold(trial):
            return None
        worth = trial.first_order(self.start)
        return Found(signal=signal, torque=torque, trial=trial, worth=worth, log_odds=worth.log_odds)

    @property
    def effort(self) -> int:
        """What one simulation costs: its integration steps in one sample."""
        return max(rival.substeps for rival in self.rivals)

    def play(self, torque: Array) -> Trial:
        """The torque in both rivals."""
        return Trial.play(self.rivals, torque, sample_time=self.sample_time, start=self.start)

    def coarse(self) -> Iterator[Found]:
        """All families on their grids, at every amplitude of the ladder that keeps the limits."""
        for bias in sorted({0.0, self.holding_torque()}):
            room = self.limits.torque - abs(bias)
            for shape in shapes(bias):
                for share in _LADDER[:: min(self.effort, 3)]:
                    found = self.attempt(replace(shape, amplitude=share * room))
                    if found is not None:
                        yield found

    def refined(self, found: Found, rng: np.random.Generator) -> Found:
        """The best of a random walk around a signal; first order picks the steps, a full refit judges them."""
        best = found
        for _ in range(max(_NEIGHBOURS // self.effort, 5)):
            near = self.attempt(best.signal.varied(rng, self.limits.torque))
            if near is not None and near.worth.log_odds > _PROMISING * best.worth.log_odds:
                near = self.settled(near, above=best.log_odds)
                best = max(best, near, key=lambda found: found.log_odds)
        return best

    def settled(self, found: Found, *, above: float = 0.0) -> Found:
        """The same signal, judged by a full refit of the rivals, as far as it is worth it."""
        return replace(found, log_odds=found.trial.settled(self.start, above=above))

    def best(self, seed: int) -> Found:
        """The best signal: the leaders of the families judged by a full refit, the best of these refined."""
        leaders: dict[str, Found] = {}
        for found in self.coarse():
            kept = leaders.get(found.signal.family)
            if kept is None or found.worth.log_odds > kept.worth.log_odds:
                leaders[found.signal.family] = found
        if not leaders:
            raise BadParameter(
                f"No signal keeps the machine within a speed of {self.limits.speed:g} and a travel from "
                f"{self.limits.travel[0]:g} to {self.limits.travel[1]:g} when it starts at rest at {self.start:.3g}: "
                "give it more room, or begin where it rests."
            )
        rng = np.random.default_rng(seed)
        judged = sorted(map(self.settled, leaders.values()), key=lambda found: -found.log_odds)
        return max((self.refined(found, rng) for found in judged[:_FINALISTS]), key=lambda found: found.log_odds)

    def plain_chirp(self) -> Found | None:
        """A plain chirp at the largest amplitude that keeps the limits, the better one of with and without a bias."""
        numbers = dict(zip(("start", "stop"), _PLAIN, strict=True))
        tried = []
        for bias in sorted({0.0, self.holding_torque()}):
            for share in np.geomspace(1.0, 0.02, 12):
                amplitude = float(share) * (self.limits.torque - abs(bias))
                found = self.attempt(Signal(family="chirp", amplitude=amplitude, bias=bias, numbers=numbers))
                if found is not None:
                    tried.append(self.settled(found))
                    break
        return max(tried, key=lambda found: found.log_odds, default=None)

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
