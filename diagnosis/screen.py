"""Screen: which effects would explain what a fitted model misses, without refitting any (score test).

Every effect says by which torque, or error of the reading, it would show along the model's motion (its traces). All of
them pass through the same linearised predictor into the innovations. What the parameters of the model and the initial
states can absorb is projected out, and the rest is regressed on the innovations (Rao 1948; the Lagrange multiplier
test).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import lsq_linear

from diagnosis.linear import Linear, linearised, response, score
from diagnosis.odds import smooth_evidence
from identification.fit_result import Fit
from identification.log import Run
from identification.noise import coloured_information
from identification.predictor import Prediction, observer_gain, stack
from identification.problem import Problem
from plant.effects import Effect, Motion, Trace
from plant.effects.effect import Array
from plant.servo import ServoModel

_NEAR = 0.4  # share of the best shape's evidence that makes another a start of its own, where there are many peaks
_STARTS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class Suspect:
    """An effect that the screen has looked at.

    Attributes:
        name: of the effect.
        evidence: rise of the log-likelihood that it promises.
        columns: number of coefficients that were fitted for it; none where a prior has charged for them.
        searched: number of shapes that were compared.
        starts: the effect as the regression suggests it, to refit from: the best shape, then others nearly as good.
    """

    name: str
    evidence: float
    columns: int
    searched: int
    starts: tuple[Effect, ...]

    @property
    def score(self) -> float:
        """Evidence less the charge for the search, to rank by."""
        return self.evidence - 2.0 * float(np.log(self.searched))


@dataclass(frozen=True, kw_only=True, eq=False)
class Screen:
    """A fitted model linearised along a log, ready to be asked about traces."""

    fit: Fit
    motion: Motion
    innovations: Array
    nuisance: Array
    filters: tuple[Linear, ...]

    @classmethod
    def of(cls, fit: Fit, problem: Problem, *, bandwidth: float) -> Screen:
        """Linearise at the fit's parameters and an observer bandwidth [rad/s]."""
        values = fit.model.values
        predictions = problem.predictor.predict(values, fit.initial, bandwidth=bandwidth, width=0.0)
        innovations, nuisance = stack(predictions)
        linear = tuple(
            linearised(fit.model, run, p, bandwidth, substeps=problem.predictor.substeps)
            for run, p in zip(problem.log.runs, predictions, strict=True)
        )
        basis, triangle = np.linalg.qr(nuisance)
        kept = np.abs(np.diag(triangle)) > 1e-10 * np.abs(np.diag(triangle)).max()
        basis = basis[:, kept]
        scores = score(linear, innovations - basis @ (basis.T @ innovations))
        return cls(
            fit=fit,
            motion=_motion(fit, problem, predictions, bandwidth, scores),
            innovations=innovations,
            nuisance=basis,
            filters=linear,
        )

    @classmethod
    def views(cls, fit: Fit) -> list[tuple[Screen, float]]:
        """Screens at the fit's bandwidth and, where that is above zero, of the free simulation, if it is not hopeless.

        An observer takes over part of what a small effect does; the free simulation shows all of it. Evidence in it
        counts from the likelihood of the fit at hand: less the loss that comes with the screen.
        """
        problem = Problem.of(fit.log, fit.model, fixed=fit.fixed)
        views = [(cls.of(fit, problem, bandwidth=fit.bandwidth), 0.0)]
        free = problem.output_error(fit) if fit.bandwidth else None
        if free is not None:
            views.append((cls.of(free, problem, bandwidth=0.0), fit.log_likelihood - free.log_likelihood))
        return views

    def ask(self, effects: Mapping[str, type[Effect]]) -> list[Suspect]:
        """What each effect would explain, with its best trace; the most promising first."""
        asked = [(name, trace) for name, kind in effects.items() for trace in kind.traces(self.motion)]
        shapes: dict[str, list[tuple[float, Trace, Effect]]] = {}
        for (name, trace), (evidence, coefficients) in zip(asked, self.regress(t for _, t in asked), strict=True):
            shapes.setdefault(name, []).append((evidence, trace, trace.start(coefficients)))
        suspects = []
        for name, tried in shapes.items():
            tried.sort(key=lambda shape: -shape[0])
            evidence, trace, _ = tried[0]
            near = [start for e, _, start in tried if e > _NEAR * evidence] if effects[name].rugged else []
            suspects.append(
                Suspect(
                    name=name,
                    evidence=evidence,
                    columns=0 if trace.prior is not None else trace.columns.shape[1],
                    # A grid along which there is one peak has only helped to find it.
                    searched=trace.searched if effects[name].rugged else 1,
                    starts=tuple(near[:_STARTS]) or (tried[0][2],),
                )
            )
        return sorted(suspects, key=lambda suspect: -suspect.score)

    def regress(self, traces: Iterable[Trace], *, discounted: bool = False) -> Iterator[tuple[float, Array]]:
        """Evidence and coefficients of each trace; evidence discounted for the colour of the innovations on request."""
        asked = list(traces)
        if not asked:
            return
        on_reading = np.concatenate([np.full(t.columns.shape[1], t.acts_on == "reading") for t in asked])
        responses = response(self.filters, np.hstack([trace.columns for trace in asked]), on_reading)
        e = self.innovations - self.nuisance @ (self.nuisance.T @ self.innovations)
        responses = responses - self.nuisance @ (self.nuisance.T @ responses)
        n, first = self.fit.samples, 0
        total = float(e @ e)
        for trace in asked:
            regressors = -responses[:, first : first + trace.columns.shape[1]]
            first += trace.columns.shape[1]
            size = np.sqrt(np.maximum((regressors**2).sum(axis=0), 1e-300))
            if trace.prior is not None:
                evidence, coefficients = smooth_evidence(regressors, e, trace.prior)
            else:
                coefficients = _coefficients(regressors / size, e, trace.positive) / size
                left = float(((e - regressors @ coefficients) ** 2).sum())
                evidence = 0.5 * n * float(np.log(total / max(left, 1e-300 + 1e-12 * total)))
            yield (evidence / self._widening(regressors / size) if discounted else evidence), coefficients

    def _widening(self, regressors: Array) -> float:
        """Factor by which the innovations' colour widens the variance of regression coefficients, at least 1."""
        white = float(np.mean(self.innovations**2)) * float((regressors**2).sum())
        coloured = float(np.trace(coloured_information(regressors, self.innovations)))
        return max(coloured / max(white, 1e-300), 1.0)


def _coefficients(regressors: Array, e: Array, positive: tuple[bool, ...]) -> Array:
    """(m,) least-squares coefficients, some of which cannot be negative."""
    if not any(positive):
        return np.asarray(np.linalg.lstsq(regressors, e, rcond=1e-8)[0])
    orthogonal, triangle = np.linalg.qr(regressors)
    least = np.where(positive, 0.0, -np.inf)
    return np.asarray(lsq_linear(triangle, orthogonal.T @ e, bounds=(least, np.inf)).x)


def _motion(
    fit: Fit, problem: Problem, predictions: list[Prediction], bandwidth: float, scores: tuple[Array, Array]
) -> Motion:
    """The model's motion, for the effects to draw their traces along."""
    runs = problem.log.runs
    velocity = np.concatenate([p.states[1] for p in predictions])
    command = np.concatenate([run.command for run in runs])
    gain, output = (np.concatenate([getattr(run, name) for run in runs]) for name in ("servo_gain", "output"))
    limit = np.repeat([run.command_limit for run in runs], [len(run) for run in runs])

    def law(command: Array) -> Array:
        return np.asarray(np.clip(command - gain * output, -limit, limit))

    dt = runs[0].sample_time
    typical = float(np.quantile(np.abs(velocity), 0.9))
    return Motion(
        time=np.concatenate([run.time for run in runs]),
        angle=np.concatenate([p.states[0] for p in predictions]),
        velocity=velocity,
        acceleration=np.concatenate([_acceleration(r, p, bandwidth) for r, p in zip(runs, predictions, strict=True)]),
        command=command,
        servo_gain=gain,
        torque=law(command),
        score=scores[0],
        reading_score=scores[1],
        inertia=float(fit.model.inertia),
        law=law,
        arriving=lambda torque: _arriving(fit.model, torque, velocity),
        run=np.repeat(np.arange(len(runs)), [len(run) for run in runs]),
        velocity_resolution=max(1e-3 * typical, fit.noise_std * bandwidth * np.sqrt(bandwidth * dt), 1e-12),
    )


def _arriving(model: ServoModel, torque: Array, velocity: Array) -> Array:
    """(T,) what of a torque (T,) arrives at the load when every lag has settled [N m]."""
    settled: Any = ca.DM(torque)
    for effect in model.effects:
        settled = effect.command(settled, settled, ca.DM(velocity))
    return np.array(settled).ravel()


def _acceleration(run: Run, prediction: Prediction, bandwidth: float) -> Array:
    """(T,) acceleration of the model over each sample [rad/s^2], without the jumps of the observer's corrections."""
    dt = np.diff(run.time)
    corrected = prediction.states[1] + observer_gain(bandwidth, np.append(dt, dt[-1]))[1] * prediction.innovations
    steps = (prediction.states[1, 1:] - corrected[:-1]) / dt
    return np.append(steps, steps[-1])
