"""Screen: which effects would explain what a fitted model misses, without refitting any (score test).

Every effect says by which torque, or error of the reading, it would show along the model's motion (its traces). All of
them pass through the same linearised predictor into the innovations. What the parameters of the model and the initial
states can absorb is projected out, and the rest is regressed on the innovations (Rao 1948; the Lagrange multiplier
test).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from diagnosis.linear import AT_ONCE, Linear, linearised, response, score
from diagnosis.model_probability import UNKNOWN, smooth_evidence
from diagnosis.motion import motion_of
from diagnosis.nuisance import Nuisance
from identification.fit_result import Fit
from identification.least_squares import bounded_least_squares
from identification.noise import coloured_information
from identification.problem import Problem
from identification.threads import in_threads
from plant.effects import Effect, Motion, Trace
from plant.effects.effect import Array

_NEAR = 0.4  # share of the best shape's evidence that makes another a start of its own, where there are many peaks
_STARTS = 8
_NOTICED = 2  # digits of an evidence; shapes that are alike in them are in the order in which the effect names them
_SHARPENED = 12  # of the best shapes that are looked at more closely ...
_ROWS = 100_000  # ... in logs up to that long; in longer ones fewer, for it takes as long as the rest of the screen


@dataclass(frozen=True, kw_only=True, eq=False)
class ScreenedEffect:
    """An effect that the screen has looked at.

    Attributes:
        name: of the effect.
        evidence: rise of the log-likelihood that it promises.
        coefficients: number of parameters to pay for one by one: all that it has, but for those of a search that is
            charged for, and none where a prior has charged for them.
        searched: number of shapes that were compared.
        starts: the effect as the regression suggests it, to refit from: the best shape, then others nearly as good.
    """

    name: str
    evidence: float
    coefficients: int
    searched: int
    starts: tuple[Effect, ...]

    @property
    def score(self) -> float:
        """Evidence less the charge for the search, to rank by."""
        return self.evidence - 2.0 * float(np.log(self.searched))


class _Shape(NamedTuple):
    """One shape of an effect that the screen has tried, without its columns, which are as long as the log."""

    evidence: float
    coefficients: int
    searched: int
    start: Effect


def excess_of_neighbouring_peaks(fit: Fit, name: str) -> float | None:
    """How much more the neighbours of a fitted effect explain than chance would; None where there is no telling.

    Beside the effect itself, and the other parameters: twice what a regression of white noise on some columns explains
    is distributed as chi-squared, with as many degrees of freedom. Shapes that are alike may explain much for no other
    reason than that the effect is not quite that; only that they explain little tells something.
    """
    effect = fit.model.effect(name)
    if effect is None or fit.runs_off:
        return None
    screen = Screen.of(fit, Problem.of(fit.log, fit.model, known=fit.known), bandwidth=fit.bandwidth)
    beside = (replace(trace, positive=()) for trace in effect.neighbours(screen.motion))
    peaks = [2.0 * seen / chi2.median(trace.columns.shape[1]) for trace, seen, _ in screen.regress(beside)]
    typical = float(np.median(peaks)) if peaks else np.inf
    return typical if typical < (np.inf if effect.of_lines else UNKNOWN) else None


@dataclass(frozen=True, kw_only=True, eq=False)
class Screen:
    """A fitted model linearised along a log, ready to be asked about traces."""

    fit: Fit
    motion: Motion
    innovations: Array
    nuisance: Nuisance
    filters: tuple[Linear, ...]

    @property
    def runs_off(self) -> bool:
        """Whether the motion grows without bound, integrated as finely as the fitted values ask for."""
        return not np.isfinite(self.motion.angle).all()

    @classmethod
    @np.errstate(over="ignore", invalid="ignore")  # of a motion that grows without bound
    def of(cls, fit: Fit, problem: Problem, *, bandwidth: float) -> Screen:
        """Linearise at the fit's parameters and an observer bandwidth [rad/s]."""
        values = fit.model.values
        predictions = problem.predictor.predict(values, fit.initial, bandwidth=bandwidth, width=0.0)
        innovations, nuisance = np.concatenate([p.innovations for p in predictions]), Nuisance.of(predictions)
        linear = tuple(
            linearised(fit.model, run, p, bandwidth, substeps=problem.predictor.substeps, colour=problem.log.colour)
            for run, p in zip(problem.log.runs, predictions, strict=True)
        )
        scores = score(linear, nuisance.beyond(innovations)[:, None])
        motion = motion_of(fit, problem, predictions, bandwidth, scores)
        return cls(
            fit=fit,
            motion=replace(motion, chance=cache(partial(_chance, linear, nuisance))),
            innovations=innovations,
            nuisance=nuisance,
            filters=linear,
        )

    @classmethod
    def views(cls, fit: Fit) -> list[tuple[Screen, float]]:
        """Screens at the fit's bandwidth and, where that is above zero, of the free simulation, if it is not hopeless.

        An observer takes over part of what a small effect does; the free simulation shows all of it. Evidence in it
        counts from the likelihood of the fit at hand: less the loss that comes with the screen. Where the free one is
        likelier there is none; what the model gains without any effect is no effect's.
        """
        problem = Problem.of(fit.log, fit.model, known=fit.known)
        views = [(cls.of(fit, problem, bandwidth=fit.bandwidth), 0.0)]
        free = problem.output_error(fit) if fit.bandwidth else None
        if free is not None and not free.runs_off:
            views.append((cls.of(free, problem, bandwidth=0.0), max(fit.log_likelihood - free.log_likelihood, 0.0)))
        return views

    def ask(self, effects: Mapping[str, type[Effect]]) -> list[ScreenedEffect]:
        """What each effect would explain, with its best trace; the most promising first."""
        suspects = in_threads(self._suspect, effects.values())
        return sorted((suspect for suspect in suspects if suspect is not None), key=lambda suspect: -suspect.score)

    def _suspect(self, kind: type[Effect]) -> ScreenedEffect | None:
        """An effect with its best trace, None where it has none."""
        tried: list[_Shape] = []
        for trace, evidence, coefficients in self.regress(kind.traces(self.motion)):
            # A grid along which there is one peak only helps to find it; what shapes it is a parameter like any other.
            searched = trace.searched if kind.multimodal else 1
            paid = trace.columns.shape[1] if kind.multimodal else len(kind.parameters())
            paid = 0 if trace.prior is not None else paid
            tried.append(_Shape(round(evidence, _NOTICED), paid, searched, trace.start(coefficients)))
        if not tried:
            return None
        tried.sort(key=lambda shape: -shape.evidence)
        best_few = _SHARPENED * _ROWS // max(len(self.innovations), _ROWS)
        tried[:best_few] = self._sharpened(tried[:best_few])
        best = max(tried, key=lambda shape: shape.evidence - np.log(shape.searched))
        # Whoever has been searched for longer would not have paid for it.
        near = [s for s in tried if s.evidence > _NEAR * best.evidence and s.searched <= best.searched]
        starts = [s.start for s in sorted(near, key=lambda s: -s.evidence)] if kind.multimodal else []
        return ScreenedEffect(
            name=kind.name,
            evidence=best.evidence,
            coefficients=best.coefficients,
            searched=best.searched,
            starts=tuple(starts[:_STARTS]) or (best.start,),
        )

    def _sharpened(self, shapes: list[_Shape]) -> list[_Shape]:
        """Each shape, or the best of those that lie closer to it than the search looks."""
        best, owners = list(shapes), list[int]()

        def closer() -> Iterator[Trace]:
            for place, shape in enumerate(shapes):
                for trace in shape.start.closer(self.motion):
                    owners.append(place)
                    yield trace

        for row, (trace, evidence, coefficients) in enumerate(self.regress(closer())):
            own = owners[row]
            if evidence > best[own].evidence:
                best[own] = best[own]._replace(evidence=evidence, start=trace.start(coefficients))
        return best

    def regress(self, traces: Iterable[Trace], *, discounted: bool = False) -> Iterator[tuple[Trace, float, Array]]:
        """Evidence and coefficients of each trace; evidence discounted for the colour of the innovations on request.

        A few traces are drawn and followed at a time, for their columns are as long as the log.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            e = self.nuisance.beyond(self.innovations)
            power = max(float(e @ e), 1e-300)
        if not np.isfinite(power):  # of a simulation that runs off nothing says what it lacks
            yield from ((trace, 0.0, np.zeros(trace.columns.shape[1])) for trace in traces)
            return
        for some in _handfuls(traces):
            columns = np.hstack([trace.columns for trace in some]) if len(some) > 1 else some[0].columns
            regressors = response(self.filters, columns, on_reading=some[0].acts_on == "reading")
            np.negative(regressors, out=regressors)
            information, pull = self.nuisance.information(regressors, e)
            first = 0
            for trace in some:
                own = slice(first, first + trace.columns.shape[1])
                first = own.stop
                evidence, coefficients = self._regression(information[own, own], pull[own], power, trace)
                wide = self._widening(self.nuisance.beyond(regressors[:, own])) if discounted else 1.0
                yield trace, evidence / wide, coefficients

    def _regression(self, information: Array, pull: Array, power: float, trace: Trace) -> tuple[float, Array]:
        """Evidence and coefficients from the products of the regressors, and with innovations of that power."""
        if trace.prior is not None:
            variance = power / len(self.innovations)
            return smooth_evidence(information / variance, pull / variance, trace.prior)
        found = bounded_least_squares(information, pull, trace.positive)
        left = 1.0 - float(2.0 * pull @ found - found @ information @ found) / power
        return -0.5 * self.fit.samples * float(np.log(max(left, 1e-12))), found

    def _widening(self, regressors: Array) -> float:
        """Factor by which the innovations' colour widens the variance of regression coefficients, at least 1."""
        scaled = regressors / np.sqrt(np.maximum((regressors**2).sum(axis=0), 1e-300))
        white = float(np.mean(self.innovations**2)) * float((scaled**2).sum())
        coloured = float(np.trace(coloured_information(scaled, self.innovations)))
        return max(coloured / max(white, 1e-300), 1.0)


def _handfuls(traces: Iterable[Trace]) -> Iterator[list[Trace]]:
    """The traces a few at a time: with as many columns together as are followed at once, or one that has more.

    Those of torques and those of errors of the reading apart.
    """
    some: list[Trace] = []
    for trace in traces:
        full = sum(t.columns.shape[1] for t in (*some, trace)) > AT_ONCE
        if some and (full or trace.acts_on != some[0].acts_on):
            yield some
            some = []
        some.append(trace)
    if some:
        yield some


def _chance(linear: tuple[Linear, ...], nuisance: Nuisance) -> tuple[Array, Array]:
    """(T, M) both scores of as many draws of white noise as are followed at once, the same each time."""
    draws = np.random.default_rng(0).normal(size=(len(nuisance.shared), AT_ONCE))
    return score(linear, nuisance.beyond(draws))
