"""A least-squares problem on a log: the path along which its objective is minimised.

The noise ratio, as the observer bandwidth of `identification.predictor`, is fitted together with the parameters. The
path goes from a large bandwidth, where every start converges, to a small one, where the parameters are most accurate,
and ends with a free simulation (bandwidth 0); the best likelihood is selected. Dry friction is smoothed along the path
and exact at the end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from identification.bandwidth import adjacent, between, parabola_top
from identification.fit_result import Fit
from identification.least_squares import Minimum
from identification.log import Log
from identification.noise import log_likelihood, short_autoregression
from identification.objective import Objective
from identification.predictor import DIVERGED, HELD, measured_state
from identification.regression import starting_values
from identification.standard_errors import divergent_fit, fit_with_errors
from identification.unsettled_start import unsettled_if_shown
from plant.effects.effect import Array

_BRACKETS = 5  # steps by a factor of two in search of the best bandwidth
_COLOURINGS = 3  # iterations between the colour of the errors and the fit
_PARTS, _PART = 10, 5000  # parts of a long log, and samples of each, for the starting values
_MOST_ITERATIONS = 200  # most iterations of a minimisation that has to converge
_POLISH = 1e-8  # gain in log-likelihood below which the refinement stops
_HOPELESS = 4.0  # loss of log-likelihood per sample at a lower bandwidth that no refit can recover


@dataclass(frozen=True, kw_only=True, eq=False)
class _Trial:
    """A minimum at one bandwidth, and its score (log-likelihood less a penalty)."""

    minimum: Minimum
    score: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem(Objective):
    """A fit before it is solved."""

    def solve(
        self,
        *,
        starts: Sequence[Array] | None = None,
        free: bool = False,
        progress: Callable[[str], None] | None = None,
    ) -> Fit:
        """Fit from scratch: starts from the data, bandwidth from large to zero, friction from smooth to exact.

        Args:
            starts: parameter vectors (P,) to start from, in addition to those of the model and of the data.
            free: fit the output error (open-loop simulation), even if an observer is more likely.
            progress: called with a line of text at each stage.
        """
        widest = 0.1 / self.log.runs[0].sample_time
        at_first = first_states(self.log)
        candidates = [self.model.values, *(starts or ()), *starting_values(_parts(self.log), self.model)]
        points = [np.clip(self.pack(values, at_first), self.lower, self.upper) for values in candidates]
        visited: list[tuple[float, Minimum]] = []
        bandwidths = [widest, widest / 15.0, widest / 200.0, 0.0]
        for bandwidth, width in zip(bandwidths, self.widths(), strict=True):
            point = self._nearest(points, bandwidth, width)
            best = self.minimise(point, bandwidth, width, iterations=30)
            if visited and bandwidth and not self._plausible(best):
                break
            visited.append((bandwidth, best))
            points.append(best.point)
            if progress is not None:
                progress(f"observer at {bandwidth:.3g} rad/s: noise {np.sqrt(best.equations.cost / self.samples):.3g}")
        if free and not bandwidth:
            return fit_with_errors(self, 0.0, best, best.evaluations)
        smoothed = self.model.slides
        trials = {
            bandwidth: self._trial(minimum.point, bandwidth, 4) if smoothed else self._judged(minimum, bandwidth)
            for bandwidth, minimum in visited
        }
        return self._held(self._finished(trials, sum(m.evaluations for _, m in visited)))

    def _plausible(self, minimum: Minimum) -> bool:
        """Whether motion and sensitivities stay bounded; without an observer those of an unstable load do not."""
        if not np.isfinite(minimum.equations.cost):
            return False
        runs = self.log.runs
        initials = len(self.predictor.fitted_starts)
        if not initials:  # nothing is simulated
            return True
        grown = np.diag(minimum.equations.information)[-initials * len(runs) :]
        grown = grown[measured_state(self.log.response) :: initials]
        most = DIVERGED**2 * np.array([len(run) for run in runs])
        return self.model.chaotic or bool((grown <= most).all())

    def widths(self) -> list[float]:
        """Widths of the smoothing of dry friction, from wide to exact [rad/s], one per stage of the bandwidth."""
        speeds = [np.abs(np.diff(run.output[run.valid]) / np.diff(run.time[run.valid])) for run in self.log.runs]
        typical = float(np.quantile(np.concatenate(speeds), 0.9)) or 1.0
        return [0.1 * typical, 0.02 * typical, 0.004 * typical, 0.0]

    def _nearest(self, points: Sequence[Array], bandwidth: float, width: float) -> Array:
        """The point (F + R I,) with the smallest cost."""
        return min(points, key=lambda point: self.cost(point, bandwidth, width))

    def begun(self, start: Fit, bandwidth: float | None = None) -> Minimum:
        """The first minimum from the fit of a simpler model.

        Args:
            start: gives the initial states and the parameters of the same name; others start at the model's values.
            bandwidth: by default that of the fit, from which `descend` begins.
        """
        point, bandwidth = self._taken_over(start), self._highest(start) if bandwidth is None else bandwidth
        if self.model.slides and not start.model.slides:
            for width in self.widths()[1:3]:
                point = self.minimise(point, bandwidth, width, iterations=3).point
        return self.minimise(point, bandwidth, 0.0, iterations=6)

    def _highest(self, start: Fit) -> float:
        """First bandwidth of `descend`; at least `HELD` if chaotic, as its likelihood is multimodal at a lower one."""
        return max(start.bandwidth, HELD / self.log.sample_time) if self.model.chaotic else start.bandwidth

    def descend(self, start: Fit, begun: Minimum | None = None) -> Fit:
        """Fit that starts from the fit of a simpler model: at its bandwidth first, then lower while the score rises.

        Args:
            start: as in `begun`.
            begun: the result of `begun`, if it is known.
        """
        bandwidth = highest = self._highest(start)
        trials = {bandwidth: self._judged(self.begun(start) if begun is None else begun, bandwidth)}
        slowest = 1.0 / max(run.duration for run in self.log.runs)
        while bandwidth:
            last = trials[bandwidth]
            bandwidth = bandwidth / 4.0 if bandwidth > 4.0 * slowest else 0.0
            if self.is_hopeless(last.minimum, bandwidth):
                break
            trials[bandwidth] = self._trial(last.minimum.point, bandwidth, iterations=5)
            if trials[bandwidth].score < last.score - 10.0:
                break
        if 0.0 not in trials:
            best = max(trials.values(), key=lambda trial: trial.score).minimum
            if not self.is_hopeless(best, 0.0):
                trials[0.0] = self._trial(best.point, 0.0, iterations=10)
        if not highest and trials[0.0].score < start.log_likelihood:
            self._risen(trials, 4.0 * slowest)
        evaluations = sum(trial.minimum.evaluations for trial in trials.values())
        trials = {at: trial for at, trial in trials.items() if self._plausible(trial.minimum)}
        if not trials:
            return divergent_fit(self, start.initial, highest, evaluations)
        found = self._finished(trials, evaluations)
        return self._held((self.log.colour and self.recoloured(found)) or found)

    def recoloured(self, fit: Fit, least: float = -np.inf) -> Fit | None:
        """The fit with coloured measurement noise: colour of its errors and parameters are estimated by turns.

        None if its log-likelihood is below `least`, or if its motion grows without bound.
        """
        problem, point, evaluations = self, self.pack(fit.model.values, fit.initial), fit.evaluations
        for _ in range(_COLOURINGS):
            values, initial = self.unpack(point)
            predictions = problem.predictor.predict(
                values, initial, bandwidth=fit.bandwidth, width=0.0, sensitivities=False
            )
            colour = short_autoregression(np.concatenate([p.errors for p in predictions]))
            log, predictor = replace(self.log, colour=colour), replace(self.predictor, colour=colour)
            problem = replace(self, log=log, predictor=predictor)
            best = problem.minimise(point, fit.bandwidth, 0.0, 10)
            point, evaluations = best.point, evaluations + best.evaluations
            if best.evaluations == 1:  # no change of the point, and so none of the colour
                break
        if not self._plausible(best) or log_likelihood(best.equations.cost, self.samples) < least:
            return None
        ended = problem.ended(best, fit.bandwidth)
        return fit_with_errors(problem, fit.bandwidth, ended, evaluations - best.evaluations)

    def polished(self, fit: Fit) -> Fit:
        """The fit refined to the exact maximum of its likelihood, so that it does not depend on the path."""
        point = self.pack(fit.model.values, fit.initial)
        best = replace(self.minimise(point, fit.bandwidth, 0.0, tolerance=_POLISH), converged=fit.converged)
        return replace(
            fit_with_errors(self, fit.bandwidth, best, fit.evaluations), held_log_likelihood=fit.held_log_likelihood
        )

    def _held(self, fit: Fit) -> Fit:
        """The fit of a chaotic model with its log-likelihood at the bandwidth `HELD`; other fits are unchanged."""
        if not self.model.chaotic:
            return fit
        problem = replace(self, log=fit.log, predictor=replace(self.predictor, colour=fit.log.colour))
        point = problem.pack(fit.model.values, fit.initial)
        cost = problem.minimise(point, HELD / self.log.sample_time, 0.0, iterations=6).equations.cost
        return replace(fit, held_log_likelihood=log_likelihood(cost, self.samples))

    def _risen(self, trials: dict[float, _Trial], bandwidth: float) -> None:
        """Raise the bandwidth while the score rises: the observer replaces what the model explains less than before."""
        best, fastest = trials[0.0], 1.0 / self.log.runs[0].sample_time
        while bandwidth < fastest:
            trial = trials[bandwidth] = self._trial(best.minimum.point, bandwidth, iterations=5)
            if trial.score < best.score:
                break
            best, bandwidth = trial, 4.0 * bandwidth

    def glance(self, start: Fit, bandwidth: float, iterations: int = 4) -> float:
        """Cost at a bandwidth after a few iterations from another fit, or none: a quick test before `descend`."""
        if not iterations:
            return self.cost(self._taken_over(start), bandwidth, 0.0)
        return self.minimise(self._taken_over(start), bandwidth, 0.0, iterations).equations.cost

    def _taken_over(self, start: Fit) -> Array:
        """The point (F + R I,) with parameters and states of the same name from another fit."""
        values = self.model.values
        for place in self.free:
            name = self.model.names[place]
            if name in start.model.names:
                values[place] = start.model.values[start.model.names.index(name)]
        return self.pack(values, start.initial_of(self.model))

    def is_hopeless(self, minimum: Minimum, bandwidth: float) -> bool:
        """Whether the cost of a minimum's point at another bandwidth is too high for any fit there."""
        if not self._plausible(minimum):
            return False  # it cannot be worse at another bandwidth
        loss = 0.5 * np.log(self.cost(minimum.point, bandwidth, 0.0) / max(minimum.equations.cost, 1e-300))
        return bool(loss > _HOPELESS)

    def _trial(self, point: Array, bandwidth: float, iterations: int) -> _Trial:
        """A minimum with exact friction, and its score: the log-likelihood less the penalty for a bandwidth above 0."""
        return self._judged(self.minimise(point, bandwidth, 0.0, iterations=iterations), bandwidth)

    def _judged(self, minimum: Minimum, bandwidth: float) -> _Trial:
        charge = 0.5 * np.log(self.samples) if bandwidth else 0.0
        score = log_likelihood(minimum.equations.cost, self.samples) - charge if self._plausible(minimum) else -np.inf
        return _Trial(minimum=minimum, score=score)

    def _finished(self, trials: dict[float, _Trial], evaluations: int) -> Fit:
        """The fit at the best bandwidth, with hidden initial states if the log shows them."""
        bandwidth, minimum = self._refined(trials)
        problem, best = unsettled_if_shown(self, minimum, bandwidth)
        if problem is not self:  # without the errors of the start another observer may be better
            again: dict[float, _Trial] = {}
            for at in sorted(trials, reverse=True):
                again[at] = problem._trial(best.point, at, iterations=_MOST_ITERATIONS)
                best = again[at].minimum
            bandwidth, best = problem._refined(again)
        return fit_with_errors(problem, bandwidth, best, evaluations)

    def _refined(self, trials: dict[float, _Trial]) -> tuple[float, Minimum]:
        """The best bandwidth: bracket the best trial by its neighbours, then go twice to the vertex of a parabola.

        A bandwidth off the optimum lowers the likelihood, and would favour a competing model with a better bandwidth.
        """

        def attempt(bandwidth: float) -> None:
            if not any(abs(np.log(bandwidth / other)) < 0.03 for other in trials if other):
                trials[bandwidth] = self._trial(trials[best()].minimum.point, bandwidth, iterations=4)

        def best() -> float:
            return max(trials, key=lambda bandwidth: trials[bandwidth].score)

        fastest = 1.0 / self.log.runs[0].sample_time
        for _ in range(_BRACKETS):
            top = best()
            missing = [b for b in adjacent(top) if top and b <= fastest and not between(trials, top, b)]
            if not missing:
                break
            for bandwidth in missing:
                attempt(bandwidth)
        for _ in range(2):
            vertex = parabola_top({b: trial.score for b, trial in trials.items() if b}, best())
            if vertex is not None:
                attempt(min(vertex, fastest))
        top = best()
        found = trials[top].minimum
        return top, self.ended(found, top)

    def ended(self, minimum: Minimum, bandwidth: float) -> Minimum:
        """The minimum with exact friction, iterated until it converges."""
        if minimum.converged:
            return minimum
        return self.minimise(minimum.point, bandwidth, 0.0, iterations=_MOST_ITERATIONS, at_start=minimum.equations)


def _parts(log: Log) -> Log:
    """A part of a long log that is enough for starting values: pieces of each run, spread evenly over it."""
    if sum(map(len, log.runs)) <= _PARTS * _PART:
        return log
    parts = [
        run.slice(first, first + _PART)
        for run in log.runs
        for first in range(0, max(len(run) - _PART, 0) + 1, max(_PART, len(run) * len(log.runs) // _PARTS))
    ]
    return replace(log, runs=tuple(parts))


def first_states(log: Log) -> Array:
    """(R, 2) angle and velocity at the first sample of each run, from a line through its first samples."""
    states = np.zeros((len(log.runs), 2))
    for row, run in enumerate(log.runs):
        early = np.flatnonzero(run.valid)[:10]
        if run.response == "velocity":
            states[row] = run.output[0], np.mean(run.measured[early])
            continue
        slope, level = np.polyfit(run.time[early] - run.time[0], run.output[early], 1) if early.size > 1 else (0, 0)
        states[row] = level, slope
    return states
