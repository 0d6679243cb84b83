"""Screen: which effects would explain what a fitted model misses, without refitting any (score test).

Every effect says by which torque it would show along the model's motion (its traces). A torque on the load passes
through the linearised predictor into the innovations,

    s[k+1] = A[k] (s[k] - gain[k] s_angle[k]) + B[k] d[k],      de[k] = -s_angle[k],

which is the same filter for all, so one pass over the log serves all traces. What the parameters of the model and the
initial states can absorb is projected out, and the rest is regressed on the innovations (Rao 1948; the Lagrange
multiplier test).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.optimize import lsq_linear

from identification.fit_result import Fit
from identification.log import Run
from identification.noise import coloured_information
from identification.predictor import Prediction, run_inputs, stack
from identification.problem import Problem
from plant.discrete import INPUTS, sample_step
from plant.effects import Effect, Motion, TorqueOffset, Trace
from plant.effects.effect import Array
from plant.servo import ServoModel

_LONG_SEARCH = 100  # shapes from which a search counts as long
_NEAR = 0.5  # share of the best shape's evidence that makes another shape a start of its own


@dataclass(frozen=True, kw_only=True, eq=False)
class Suspect:
    """An effect that the screen has looked at.

    Attributes:
        name: of the effect.
        evidence: rise of the log-likelihood that it promises.
        columns: number of coefficients that were fitted for it.
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
        return self.evidence - float(np.log(self.searched))


@dataclass(frozen=True, kw_only=True, eq=False)
class Screen:
    """A fitted model linearised along a log, ready to be asked about traces."""

    fit: Fit
    motion: Motion
    innovations: Array
    nuisance: Array
    filters: tuple[tuple[Array, Array, Array], ...]

    @classmethod
    def of(cls, fit: Fit, problem: Problem, *, bandwidth: float) -> Screen:
        """Linearise at the fit's parameters and an observer bandwidth [rad/s]."""
        values = fit.model.values
        predictions = problem.predictor.predict(values, fit.initial, bandwidth=bandwidth, width=0.0)
        innovations, nuisance = stack(predictions)
        linear = [
            _linearised(fit.model, problem, run, p, bandwidth)
            for run, p in zip(problem.log.runs, predictions, strict=True)
        ]
        basis, triangle = np.linalg.qr(nuisance)
        kept = np.abs(np.diag(triangle)) > 1e-10 * np.abs(np.diag(triangle)).max()
        basis = basis[:, kept]
        score = _score(linear, innovations - basis @ (basis.T @ innovations))
        return cls(
            fit=fit,
            motion=_motion(fit, problem, predictions, bandwidth, score),
            innovations=innovations,
            nuisance=basis,
            filters=tuple(linear),
        )

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
            # A coarse grid of shapes has one basin; a long search may have its best peak beside the right one.
            near = [start for e, _, start in tried if e > _NEAR * evidence] if trace.searched > _LONG_SEARCH else []
            suspects.append(
                Suspect(
                    name=name,
                    evidence=evidence,
                    columns=trace.columns.shape[1],
                    searched=trace.searched,
                    starts=tuple(near[:3]) or (tried[0][2],),
                )
            )
        return sorted(suspects, key=lambda suspect: -suspect.score)

    def regress(self, traces: Iterable[Trace], *, discounted: bool = False) -> Iterator[tuple[float, Array]]:
        """Evidence and coefficients of each trace; evidence discounted for the colour of the innovations on request."""
        asked = list(traces)
        if not asked:
            return
        responses = self._through_filter(np.hstack([trace.columns for trace in asked]))
        e = self.innovations - self.nuisance @ (self.nuisance.T @ self.innovations)
        responses = responses - self.nuisance @ (self.nuisance.T @ responses)
        n, first = self.fit.samples, 0
        total = float(e @ e)
        for trace in asked:
            regressors = -responses[:, first : first + trace.columns.shape[1]]
            first += trace.columns.shape[1]
            size = np.sqrt(np.maximum((regressors**2).sum(axis=0), 1e-300))
            coefficients = _coefficients(regressors / size, e, trace.positive) / size
            left = float(((e - regressors @ coefficients) ** 2).sum())
            evidence = 0.5 * n * float(np.log(total / max(left, 1e-300 + 1e-12 * total)))
            yield (evidence / self._widening(regressors / size) if discounted else evidence), coefficients

    def _widening(self, regressors: Array) -> float:
        """Factor by which the innovations' colour widens the variance of regression coefficients, at least 1."""
        white = float(np.mean(self.innovations**2)) * float((regressors**2).sum())
        coloured = float(np.trace(coloured_information(regressors, self.innovations)))
        return max(coloured / max(white, 1e-300), 1.0)

    def _through_filter(self, traces: Array) -> Array:
        """Innovations' response (T, M) to load torques (T, M)."""
        response, row = np.empty_like(traces), 0
        for closed_loop, by_torque, weight in self.filters:
            state = np.zeros((closed_loop.shape[1], traces.shape[1]))
            for k in range(closed_loop.shape[0]):
                response[row + k] = -weight[k] * state[0]
                state = closed_loop[k] @ state + np.multiply.outer(by_torque[k], traces[row + k])
            row += closed_loop.shape[0]
        return response


def _coefficients(regressors: Array, e: Array, positive: tuple[bool, ...]) -> Array:
    """(m,) least-squares coefficients, some of which cannot be negative."""
    if not any(positive):
        return np.asarray(np.linalg.lstsq(regressors, e, rcond=1e-8)[0])
    orthogonal, triangle = np.linalg.qr(regressors)
    least = np.where(positive, 0.0, -np.inf)
    return np.asarray(lsq_linear(triangle, orthogonal.T @ e, bounds=(least, np.inf)).x)


def _linearised(
    model: ServoModel, problem: Problem, run: Run, prediction: Prediction, bandwidth: float
) -> tuple[Array, Array, Array]:
    """Closed-loop transition (T, n, n), response to a load torque (T, n) and weight (T,) of each sample of a run."""
    probe = model if model.effect("torque_offset") else model.with_effect(TorqueOffset(torque=0.0))
    place = probe.names.index("torque_offset.torque")
    n, count = len(probe.states), len(probe.names)
    state, inputs, parameters = ca.SX.sym("z", n), ca.SX.sym("u", len(INPUTS)), ca.SX.sym("p", count)
    following = sample_step(probe, substeps=problem.predictor.substeps)(state, inputs, parameters)
    slopes = ca.Function(
        "slopes",
        [state, inputs, parameters],
        [ca.densify(ca.jacobian(following, state)), ca.densify(ca.jacobian(following, parameters[place]))],
        {"cse": True},
    )
    data, values = run_inputs(run, probe, probe.values, bandwidth, 0.0)
    gain = np.zeros((n, data.shape[1]))
    gain[:2] = data[-2:]
    corrected = prediction.states + gain * prediction.innovations
    by_state, by_torque = slopes.map(data.shape[1])(corrected, data[: len(INPUTS)], values)
    transition = np.array(by_state).reshape(n, -1, n).transpose(1, 0, 2)
    closed = transition.copy()
    closed[:, :, 0] -= np.einsum("kij,jk->ki", transition, gain)
    return closed, np.array(by_torque).T, run.valid.astype(float)


def _score(filters: list[tuple[Array, Array, Array]], innovations: Array) -> Array:
    """(T,) how much a load torque at each sample alone would lower half the squared innovations, per N m (adjoint)."""
    score, end = np.empty_like(innovations), innovations.size
    for closed_loop, by_torque, weight in reversed(filters):
        start = end - weight.size
        push = weight * innovations[start:end]
        later = np.zeros(closed_loop.shape[1])
        for k in range(weight.size - 1, -1, -1):
            score[start + k] = by_torque[k] @ later
            later = later @ closed_loop[k]
            later[0] += push[k]
        end = start
    return score


def _motion(fit: Fit, problem: Problem, predictions: list[Prediction], bandwidth: float, score: Array) -> Motion:
    """The model's motion, for the effects to draw their traces along."""
    runs = problem.log.runs
    velocity = np.concatenate([p.states[1] for p in predictions])
    drives = [np.clip(r.command - r.servo_gain * r.output, -r.command_limit, r.command_limit) for r in runs]
    dt = runs[0].sample_time
    typical = float(np.quantile(np.abs(velocity), 0.9))
    return Motion(
        time=np.concatenate([run.time for run in runs]),
        angle=np.concatenate([p.states[0] for p in predictions]),
        velocity=velocity,
        torque=np.concatenate(drives),
        score=score,
        run=np.repeat(np.arange(len(runs)), [len(run) for run in runs]),
        velocity_resolution=max(1e-3 * typical, fit.noise_std * bandwidth * np.sqrt(bandwidth * dt), 1e-12),
    )
