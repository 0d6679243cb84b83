"""How well a torque signal tells two fitted models apart: what is left when each has done its best to mimic the other.

If A is true, B falls behind it, when its parameters and the initial state have moved by the best d, by

    lambda = n/2 log(c + m / n),      m = |e + J d|^2 / sigma^2 + d' P^-1 d,

with e the innovations of B's predictor on A's output, J their sensitivities, and P what the log leaves open of the
parameters (Atkinson and Fedorov 1975, T-optimality, with a prior). For small m and c = 1 it is m / 2. B may also take
what it misses for a load that fluctuates at random, and raise the bandwidth of its observer: e then shrinks, but the
observer follows the measurement noise, which makes the variance of its innovations larger by the factor c.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Self

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from diagnosis.experiment.time_scale import time_scale
from identification.fit_result import Fit
from identification.least_squares import NormalEquations, minimise
from identification.log import Run
from identification.observer_gain import observer_gain
from identification.predictor import Prediction, Predictor
from plant.effects.effect import Array
from plant.servo import ServoModel

_RETUNING = 8  # iterations of a full refit to the other's output
_DOUBTS = 2  # other values of the truth that an experiment should do for
_BANDWIDTHS = (0.3, 1.0, 3.0, 10.0, 30.0)  # rad/s at 5 ms, to which a mimic may raise that of its observer


@dataclass(frozen=True, kw_only=True, eq=False)
class Rival:
    """A fitted model, as far as the design of an experiment has to know it.

    Attributes:
        model: with the fitted values.
        free: (F,) places of the parameters that a refit may move.
        information: (F, F) what the log says about them, the inverse of their covariance.
        noise_std: of one sample [rad or m].
        bandwidth: of the observer [rad/s].
        substeps: integration steps in one sample.
        doubts: (P,) each, other values that the log allows, drawn from their distribution.
    """

    model: ServoModel
    free: tuple[int, ...]
    information: Array
    noise_std: float
    bandwidth: float
    substeps: int
    doubts: tuple[Array, ...]

    @classmethod
    def of(cls, fit: Fit) -> Self:
        """A fit as a rival; a direction that its log left open may move freely."""
        std = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
        scale = np.where(std > 0.0, std, 1.0)
        correlation = fit.covariance / np.outer(scale, scale)
        information = np.linalg.pinv(correlation, rcond=1e-9, hermitian=True)
        open_ = np.diag(information) < 1e-6  # what is left there is rounding
        information[open_], information[:, open_] = 0.0, 0.0
        return cls(
            model=fit.model,
            free=fit.free,
            information=information / np.outer(scale, scale),
            noise_std=fit.noise_std,
            bandwidth=fit.bandwidth,
            substeps=fit.substeps,
            doubts=tuple(_drawn(fit, np.random.default_rng(seed)) for seed in range(_DOUBTS)),
        )

    def contains(self, other: Rival) -> bool:
        """Whether the other's model is this one with a special case of one of its effects."""
        theirs = {effect.name for effect in other.model.effects}
        mine = {effect.name for effect in self.model.effects}
        special = {name for effect in self.model.effects for name in effect.contains}
        return theirs <= mine | special

    def predict(self, run: Run, values: Array, initial: Array, bandwidth: float, *, slopes: bool) -> Prediction:
        """One run under this model's structure."""
        predictor = Predictor(model=self.model, runs=(run,), free=self.free if slopes else (), substeps=self.substeps)
        with np.errstate(all="ignore"):
            return predictor.predict(values, initial[None, :], bandwidth=bandwidth, width=0.0, sensitivities=slopes)[0]


@dataclass(frozen=True, kw_only=True)
class Separation:
    """What an experiment would tell: expected log-likelihood difference, and the share of it that a refit absorbs."""

    log_odds: float
    absorbed: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """A torque signal played into both rivals.

    Attributes:
        rivals: the two.
        runs: the experiment as either would record it, without noise.
        speed: largest under either [rad/s].
        travel: least and largest angle under either [rad].
    """

    rivals: tuple[Rival, Rival]
    runs: tuple[Run, Run]
    speed: float
    travel: tuple[float, float]

    @classmethod
    def play(cls, rivals: tuple[Rival, Rival], torque: Array, *, sample_time: float, start: float) -> Trial:
        """Free simulation of both from rest at an angle."""
        blank = blank_run(torque, sample_time)
        initial = np.array([start, 0.0])
        predictions = [rival.predict(blank, rival.model.values, initial, 0.0, slopes=False) for rival in rivals]
        states = [np.nan_to_num(p.states[:2], nan=np.inf, posinf=np.inf, neginf=-np.inf) for p in predictions]
        outputs = [np.nan_to_num(p.output, nan=0.0, posinf=0.0, neginf=0.0) for p in predictions]
        return cls(
            rivals=rivals,
            runs=(replace(blank, output=outputs[0]), replace(blank, output=outputs[1])),
            speed=max(float(np.abs(s[1]).max()) for s in states),
            travel=(min(float(s[0].min()) for s in states), max(float(s[0].max()) for s in states)),
        )

    def first_order(self, start: float) -> Separation:
        """The lesser of what the experiment, begun at rest at an angle, tells if the one or the other is true."""
        return min((task.first_order() for task in self._tasks(start)), key=lambda separation: separation.log_odds)

    def settled(
        self, start: float, *, above: float = 0.0, weakest: Sequence[int] | None = None
    ) -> tuple[float, tuple[int, ...]]:
        """The log odds when the mimic iterates to its best, for every truth that the log allows; and where it did best.

        Over what the log leaves open of the truth the mean of the square root counts, so that none is given up for a
        gain where the odds are large already.

        Args:
            start: angle of rest [rad].
            above: it stops as soon as they cannot be above this.
            weakest: which of its bandwidths the mimic tries first against each truth. Those that did best against a
                similar signal make for a short trial.
        """
        tasks = self._tasks(start)
        cells = [cell for task in tasks for cell in (task, *map(task.under, task.truth.doubts))]
        places = list(weakest) if weakest else [0] * len(cells)
        odds = np.array([cell.settled(cell.bandwidths[place]) for cell, place in zip(cells, places, strict=True)])

        def worth() -> float:
            return float(np.min(np.mean(np.sqrt(odds.reshape(len(tasks), -1)), axis=1)) ** 2)

        for row, cell in enumerate(cells):
            first = places[row]
            for place, bandwidth in enumerate(cell.bandwidths):
                if worth() <= above:
                    return worth(), tuple(places)
                log_odds = odds[row] if place == first else cell.settled(bandwidth)
                if log_odds < odds[row]:
                    odds[row], places[row] = log_odds, place
        return worth(), tuple(places)

    def _tasks(self, start: float) -> list[_Mimicry]:
        """A special case is no truth that counts: the general form mimics it perfectly, and parsimony decides."""
        pairs = zip(self.rivals, reversed(self.rivals), self.runs, strict=True)
        return [
            _Mimicry(truth=truth, mimic=mimic, run=run, start=start)
            for truth, mimic, run in pairs
            if truth.contains(mimic) or not mimic.contains(truth)
        ]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Mimicry:
    """One rival's attempt to explain what the other would record."""

    truth: Rival
    mimic: Rival
    run: Run
    start: float

    def first_order(self) -> Separation:
        """After one step, at the larger of the two bandwidths."""
        bandwidth = max(self.truth.bandwidth, self.mimic.bandwidth)
        here = self._linearised(self._origin, bandwidth)
        return self._worth(here.cost, here.cost - _explained(here) if np.isfinite(here.cost) else np.inf)

    def under(self, values: Array) -> _Mimicry:
        """The same where the truth has other values (P,)."""
        played = self.truth.predict(self.run, values, np.array([self.start, 0.0]), 0.0, slopes=False)
        return replace(self, run=replace(self.run, output=np.nan_to_num(played.output, posinf=0.0, neginf=0.0)))

    @property
    def bandwidths(self) -> tuple[float, ...]:
        """To which the mimic may set that of its observer [rad/s], its own first."""
        own, slower = self.truth.bandwidth, time_scale(self.run.sample_time)
        wider = (w / slower for w in _BANDWIDTHS if w / slower > own)
        return tuple(dict.fromkeys((max(own, self.mimic.bandwidth), own, *wider)))

    def settled(self, bandwidth: float) -> float:
        """Log odds at the minimum for a bandwidth."""
        specs = [self.mimic.model.parameters[place] for place in self.mimic.free]
        best = minimise(
            partial(self._linearised, bandwidth=bandwidth),
            self._origin,
            np.array([*(spec.lower for spec in specs), -np.inf, -np.inf]),
            np.array([*(spec.upper for spec in specs), np.inf, np.inf]),
            samples=len(self.run),
            iterations=_RETUNING,
        )
        quiet, loud = (noise_factor(w, self.run.sample_time) for w in (self.truth.bandwidth, bandwidth))
        return self._worth(np.inf, best.equations.cost, loud / quiet).log_odds

    @property
    def _origin(self) -> Array:
        return np.concatenate((self.mimic.model.values[list(self.mimic.free)], (self.start, 0.0)))

    def _linearised(self, point: Array, bandwidth: float) -> NormalEquations:
        """The problem of the mimic's refit in units of the noise; its cost includes the noise that a log would hold."""
        mimic, sigma, count = self.mimic, self.truth.noise_std, len(self.mimic.free)
        values = mimic.model.values
        values[list(mimic.free)] = point[:count]
        seen = mimic.predict(self.run, values, point[count:], bandwidth, slopes=True)
        moved = point[:count] - self._origin[:count]
        with np.errstate(all="ignore"):
            data = NormalEquations.of(seen.innovations / sigma, seen.jacobian / sigma)
            pull = mimic.information @ moved
            gradient, information = data.gradient.copy(), data.information.copy()
            gradient[:count] += pull
            information[:count, :count] += mimic.information
            cost = data.cost + float(moved @ pull) + len(self.run)
        return NormalEquations(cost=cost, gradient=gradient, information=information)

    def _worth(self, before: float, after: float, louder: float = 1.0) -> Separation:
        """From the cost with the fitted parameters and with those that mimic best."""
        samples = len(self.run)
        whole, left = before - samples, min(max(after - samples, 0.0), before - samples)
        if not np.isfinite(left) or whole <= 0.0:  # what overflows decides nothing
            return Separation(log_odds=0.0, absorbed=1.0)
        log_odds = 0.5 * samples * float(np.log(louder + left / samples))
        return Separation(log_odds=log_odds, absorbed=1.0 - left / whole if np.isfinite(whole) else 1.0)


def _drawn(fit: Fit, rng: np.random.Generator) -> Array:
    """(P,) values from the distribution that a log leaves; what is positive by nature stays within a factor of five."""
    values, free = fit.model.values, list(fit.free)
    drawn = rng.multivariate_normal(values[free], fit.covariance, method="eigh", check_valid="ignore")
    for place, value in zip(free, drawn, strict=True):
        spec = fit.model.parameters[place]
        near = (values[place] / 5.0, values[place] * 5.0) if spec.lower > 0.0 else (-np.inf, np.inf)
        values[place] = np.clip(value, max(spec.lower, near[0]), min(spec.upper, near[1]))
    return values


@lru_cache(maxsize=64)
def noise_factor(bandwidth: float, sample_time: float) -> float:
    """By how much an observer that follows the measurement noise raises the variance of its innovations [-]."""
    gain = observer_gain(bandwidth, np.array([sample_time]))
    if not gain.any():
        return 1.0
    step = np.array([[1.0, sample_time], [0.0, 1.0]])
    push = step @ gain
    spread = solve_discrete_lyapunov(step - push @ np.array([[1.0, 0.0]]), push @ push.T)
    return 1.0 + float(spread[0, 0])


def _explained(equations: NormalEquations) -> float:
    """Fall of the cost that one Gauss-Newton step promises."""
    scale = np.sqrt(np.maximum(np.diag(equations.information), 1e-300))
    values, vectors = np.linalg.eigh(equations.information / np.outer(scale, scale))
    known = values > 1e-12 * values.max(initial=0.0)
    pull = vectors[:, known].T @ (equations.gradient / scale)
    return float(np.sum(pull**2 / values[known]))


def blank_run(torque: Array, sample_time: float) -> Run:
    """A torque (T,) as a run whose output is still to be recorded."""
    nothing = np.zeros(torque.size)
    return Run(
        label="separating experiment",
        number=0,
        time=np.arange(torque.size, dtype=float) * sample_time,
        command=torque,
        output=nothing,
        valid=np.ones(torque.size, dtype=bool),
        servo_gain=nothing,
    )
