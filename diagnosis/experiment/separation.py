"""Expected log-likelihood difference of two fitted models for a torque signal, after each is refitted to the other.

If A is true, the log-likelihood of B after its parameters and the initial state have moved by the best d is lower by

    lambda = n/2 log(c + m / n),      m = |e + J d|^2 / sigma^2 + d' P^-1 d,

with e the innovations of B's predictor on A's output, J their sensitivities, and P the covariance of the parameters
from the log (Atkinson and Fedorov 1975, T-optimality, with a prior). For small m and c = 1 it is m / 2. B may also
explain its error by a random-walk disturbance and raise the bandwidth of its observer: e then decreases, but the
observer follows the measurement noise, and the variance of its innovations increases by the factor c.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
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
_DRAWS = 2  # further parameter values of the true model, randomly drawn
_BANDWIDTHS = (0.3, 1.0, 3.0, 10.0, 30.0)  # rad/s at 5 ms, to which the wrong model may raise its observer bandwidth


@dataclass(frozen=True, kw_only=True, eq=False)
class CompetingModel:
    """One of the two competing models, with the data that the design of an experiment needs.

    Attributes:
        model: with the fitted values.
        free: (F,) indices of the parameters that a refit may move.
        information: (F, F) inverse of their covariance from the log.
        noise_std: of one sample [rad or m].
        bandwidth: of the observer [rad/s].
        substeps: integration steps per sample.
        drawn_values: (P,) each, other parameter values, drawn from the distribution of the estimates.
    """

    model: ServoModel
    free: tuple[int, ...]
    information: Array
    noise_std: float
    bandwidth: float
    substeps: int
    drawn_values: tuple[Array, ...]

    @classmethod
    def of(cls, fit: Fit) -> Self:
        """From a fit; parameters that its log does not determine have zero information."""
        std = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
        scale = np.where(std > 0.0, std, 1.0)
        correlation = fit.covariance / np.outer(scale, scale)
        information = np.linalg.pinv(correlation, rcond=1e-9, hermitian=True)
        open_ = np.diag(information) < 1e-6  # a rounding error
        information[open_], information[:, open_] = 0.0, 0.0
        return cls(
            model=fit.model,
            free=fit.free,
            information=information / np.outer(scale, scale),
            noise_std=fit.noise_std,
            bandwidth=fit.bandwidth,
            substeps=fit.substeps,
            drawn_values=tuple(_drawn(fit, np.random.default_rng(seed)) for seed in range(_DRAWS)),
        )

    def contains(self, other: CompetingModel) -> bool:
        """Whether every effect of the other model is one of this model or a special case of one."""
        theirs = {effect.name for effect in other.model.effects}
        mine = {effect.name for effect in self.model.effects}
        special = {name for effect in self.model.effects for name in effect.contains}
        return theirs <= mine | special

    def predict(self, run: Run, values: Array, initial: Array, bandwidth: float, *, slopes: bool) -> Prediction:
        """Prediction of one run with this model's structure."""
        predictor = Predictor(model=self.model, runs=(run,), free=self.free if slopes else (), substeps=self.substeps)
        with np.errstate(all="ignore"):
            return predictor.predict(values, initial[None, :], bandwidth=bandwidth, width=0.0, sensitivities=slopes)[0]


@dataclass(frozen=True, kw_only=True)
class Separation:
    """Expected log-likelihood difference of an experiment, and the share of m that a refit absorbs."""

    log_odds: float
    absorbed: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """A torque signal simulated with both models.

    Attributes:
        competing: the two models.
        runs: the simulated experiment with each model, without noise.
        speed: largest speed of both [rad/s].
        travel: least and largest angle of both [rad].
    """

    competing: tuple[CompetingModel, CompetingModel]
    runs: tuple[Run, Run]
    speed: float
    travel: tuple[float, float]

    @classmethod
    def play(
        cls, competing: tuple[CompetingModel, CompetingModel], torque: Array, *, sample_time: float, start: float
    ) -> Trial:
        """Free simulation of both models from rest at an angle."""
        blank = blank_run(torque, sample_time)
        initial = np.array([start, 0.0])
        predictions = [each.predict(blank, each.model.values, initial, 0.0, slopes=False) for each in competing]
        states = [np.nan_to_num(p.states[:2], nan=np.inf, posinf=np.inf, neginf=-np.inf) for p in predictions]
        outputs = [np.nan_to_num(p.output, nan=0.0, posinf=0.0, neginf=0.0) for p in predictions]
        return cls(
            competing=competing,
            runs=(replace(blank, output=outputs[0]), replace(blank, output=outputs[1])),
            speed=max(float(np.abs(s[1]).max()) for s in states),
            travel=(min(float(s[0].min()) for s in states), max(float(s[0].max()) for s in states)),
        )

    def first_order(self, start: float) -> Separation:
        """Separation to first order, from rest at an angle: the smaller of the cases that either model is true."""
        return min((task.first_order() for task in self._tasks(start)), key=lambda separation: separation.log_odds)

    def settled(
        self, start: float, *, above: float = 0.0, weakest: Sequence[int] | None = None
    ) -> tuple[float, tuple[int, ...]]:
        """The log odds after full refits of the wrong model, and the index of its best bandwidth in each case.

        There is one case for each set of true parameter values: the fitted and the drawn ones. The mean of the square
        roots counts over these, so that small log odds in one case are not compensated by large ones in another.

        Args:
            start: angle of rest [rad].
            above: the calculation stops as soon as the log odds cannot exceed this value.
            weakest: index of the bandwidth that is tried first in each case; the best ones for a similar signal save
                time.
        """
        tasks = self._tasks(start)
        cells = [cell for task in tasks for cell in (task, *map(task.under, task.truth.drawn_values))]
        places = list(weakest) if weakest else [0] * len(cells)
        by_case = np.array([cell.settled(cell.bandwidths[place]) for cell, place in zip(cells, places, strict=True)])

        def least_mean() -> float:
            return float(np.min(np.mean(np.sqrt(by_case.reshape(len(tasks), -1)), axis=1)) ** 2)

        for row, cell in enumerate(cells):
            first = places[row]
            for place, bandwidth in enumerate(cell.bandwidths):
                if least_mean() <= above:
                    return least_mean(), tuple(places)
                log_odds = by_case[row] if place == first else cell.settled(bandwidth)
                if log_odds < by_case[row]:
                    by_case[row], places[row] = log_odds, place
        return least_mean(), tuple(places)

    def _tasks(self, start: float) -> list[_Refit]:
        """The cases; a special case as the true model is left out, for the general form explains it perfectly."""
        pairs = zip(self.competing, reversed(self.competing), self.runs, strict=True)
        return [
            _Refit(truth=truth, wrong=wrong, run=run, start=start)
            for truth, wrong, run in pairs
            if truth.contains(wrong) or not wrong.contains(truth)
        ]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Refit:
    """A refit of the wrong model (`wrong`) to the output of the true one (`truth`)."""

    truth: CompetingModel
    wrong: CompetingModel
    run: Run
    start: float

    def first_order(self) -> Separation:
        """Separation after one Gauss-Newton step, at the larger of the two bandwidths."""
        bandwidth = max(self.truth.bandwidth, self.wrong.bandwidth)
        here = self._linearised(self._origin, bandwidth)
        return self._separation(here.cost, here.cost - _explained(here) if np.isfinite(here.cost) else np.inf)

    def under(self, values: Array) -> _Refit:
        """The same with other values (P,) of the true model."""
        played = self.truth.predict(self.run, values, np.array([self.start, 0.0]), 0.0, slopes=False)
        return replace(self, run=replace(self.run, output=np.nan_to_num(played.output, posinf=0.0, neginf=0.0)))

    @property
    def bandwidths(self) -> tuple[float, ...]:
        """Observer bandwidths of the wrong model [rad/s], the larger of the two fitted ones first."""
        own, slower = self.truth.bandwidth, time_scale(self.run.sample_time)
        wider = (w / slower for w in _BANDWIDTHS if w / slower > own)
        return tuple(dict.fromkeys((max(own, self.wrong.bandwidth), own, *wider)))

    def settled(self, bandwidth: float) -> float:
        """Log odds after the refit, for a bandwidth."""
        specs = [self.wrong.model.parameters[place] for place in self.wrong.free]
        best = minimise(
            lambda point, most: self._linearised(point, bandwidth),
            self._origin,
            np.array([*(spec.lower for spec in specs), -np.inf, -np.inf]),
            np.array([*(spec.upper for spec in specs), np.inf, np.inf]),
            samples=len(self.run),
            iterations=_RETUNING,
        )
        quiet, loud = (noise_factor(w, self.run.sample_time) for w in (self.truth.bandwidth, bandwidth))
        return self._separation(np.inf, best.equations.cost, loud / quiet).log_odds

    @property
    def _origin(self) -> Array:
        return np.concatenate((self.wrong.model.values[list(self.wrong.free)], (self.start, 0.0)))

    def _linearised(self, point: Array, bandwidth: float) -> NormalEquations:
        """The least-squares problem of the refit in units of the noise; its cost includes the expected noise."""
        wrong, sigma, count = self.wrong, self.truth.noise_std, len(self.wrong.free)
        values = wrong.model.values
        values[list(wrong.free)] = point[:count]
        seen = wrong.predict(self.run, values, point[count:], bandwidth, slopes=True)
        moved = point[:count] - self._origin[:count]
        with np.errstate(all="ignore"):
            data = NormalEquations.of(seen.innovations / sigma, seen.jacobian / sigma)
            pull = wrong.information @ moved
            gradient, information = data.gradient.copy(), data.information.copy()
            gradient[:count] += pull
            information[:count, :count] += wrong.information
            cost = data.cost + float(moved @ pull) + len(self.run)
        return NormalEquations(cost=cost, gradient=gradient, information=information)

    def _separation(self, before: float, after: float, noise_ratio: float = 1.0) -> Separation:
        """Separation from the cost with the fitted parameters and with the refitted ones."""
        samples = len(self.run)
        whole, left = before - samples, min(max(after - samples, 0.0), before - samples)
        if not np.isfinite(left) or whole <= 0.0:  # a simulation that overflows decides nothing
            return Separation(log_odds=0.0, absorbed=1.0)
        log_odds = 0.5 * samples * float(np.log(noise_ratio + left / samples))
        return Separation(log_odds=log_odds, absorbed=1.0 - left / whole if np.isfinite(whole) else 1.0)


def _drawn(fit: Fit, rng: np.random.Generator) -> Array:
    """(P,) values drawn from the distribution of the estimates; positive parameters stay within a factor of five."""
    values, free = fit.model.values, list(fit.free)
    drawn = rng.multivariate_normal(values[free], fit.covariance, method="eigh", check_valid="ignore")
    for place, value in zip(free, drawn, strict=True):
        spec = fit.model.parameters[place]
        near = (values[place] / 5.0, values[place] * 5.0) if spec.lower > 0.0 else (-np.inf, np.inf)
        values[place] = np.clip(value, max(spec.lower, near[0]), min(spec.upper, near[1]))
    return values


@lru_cache(maxsize=64)
def noise_factor(bandwidth: float, sample_time: float) -> float:
    """Factor on the variance of the innovations if the observer follows the measurement noise [-]."""
    gain = observer_gain(bandwidth, np.array([sample_time]))
    if not gain.any():
        return 1.0
    step = np.array([[1.0, sample_time], [0.0, 1.0]])
    push = step @ gain
    spread = solve_discrete_lyapunov(step - push @ np.array([[1.0, 0.0]]), push @ push.T)
    return 1.0 + float(spread[0, 0])


def _explained(equations: NormalEquations) -> float:
    """Predicted decrease of the cost by one Gauss-Newton step."""
    scale = np.sqrt(np.maximum(np.diag(equations.information), 1e-300))
    values, vectors = np.linalg.eigh(equations.information / np.outer(scale, scale))
    known = values > 1e-12 * values.max(initial=0.0)
    pull = vectors[:, known].T @ (equations.gradient / scale)
    return float(np.sum(pull**2 / values[known]))


def blank_run(torque: Array, sample_time: float) -> Run:
    """A torque (T,) as a run with zero output."""
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
