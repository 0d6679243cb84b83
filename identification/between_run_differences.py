"""Test whether the runs of a log agree about the parameters of their common fit, and find those that differ.

At the common optimum, one Newton step per parameter estimates its value in each run while all others are shared. Model
errors are not noise: they are correlated over long times, and the likelihood counts the same error many times. So each
run is cut into blocks, and the uncertainty of a run's value is its change when a block is left out (jackknife over
clusters, in closed form: Bell and McCaffrey 2002). The runs disagree about a parameter only if it differs between the
runs by more than between the blocks of a run. Each run has only a few blocks, so the test is that of Welch (1951) for
groups of unequal scatter, at a level shared by all parameters (Bonferroni).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from identification.fit_result import Fit
from identification.objective import Objective
from identification.per_run import PerRun
from identification.predictor import Prediction
from identification.sums_over_runs import places, point_size
from plant import ServoModel
from plant.effects.effect import Array
from plant.effects.nonparametric_curve import Nonparametric
from plant.uncertain_number import measured

BLOCKS = 8  # of each run
_LEVEL = 1e-3  # probability of reporting a difference between equal runs
_ALONE = 0.99  # share of the information that a single block must not have


@dataclass(frozen=True, kw_only=True, eq=False)
class _Run:
    """Normal equations of each block of a run for its parameters and initial state.

    information: (B, n, n) Jacobian transposed times Jacobian of each block; scores: (B, n) gradient.
    """

    information: Array
    scores: Array

    @classmethod
    def of(cls, prediction: Prediction, valid: NDArray[np.bool_]) -> _Run:
        """From a run's innovations; its valid samples are cut into `BLOCKS` blocks."""
        blocks = np.array_split(np.flatnonzero(valid), BLOCKS)
        slopes, innovations = prediction.jacobian, prediction.innovations
        return cls(
            information=np.array([slopes[block].T @ slopes[block] for block in blocks]),
            scores=np.array([slopes[block].T @ innovations[block] for block in blocks]),
        )

    def about(self, rows: list[int]) -> _Run:
        """The normal equations of some rows alone."""
        return _Run(information=self.information[:, rows][:, :, rows], scores=self.scores[:, rows])

    def scatters(self, row: int) -> bool:
        """Whether more than one block determines a row; otherwise its scatter is unknown."""
        information = self.information[:, row, row]
        return bool(information.max() < _ALONE * information.sum())


def between_run_differences(fit: Fit) -> str | None:
    """A sentence on the parameters that differ between the runs of a fit, and by how much; None if they agree."""
    if len(fit.log.runs) < 2 or not fit.free or not fit.converged:
        return None
    objective = Objective.of(fit.log, fit.model, fixed=fit.fixed)
    values = fit.model.values
    predictions = objective.predictor.predict(values, fit.initial, bandwidth=fit.bandwidth, width=0.0)
    runs = [_Run.of(prediction, run.valid) for prediction, run in zip(predictions, fit.log.runs, strict=True)]
    if not all(np.isfinite(run.information).all() and np.isfinite(run.scores).all() for run in runs):
        return None
    lines = [fit[fit.model.names[place]] for place in fit.free]
    determined = [
        row
        for row, line in enumerate(lines)
        if line.value is not None and not line.at_bound and not is_coefficient(fit.model, line.name)
    ]
    starts = range(len(lines), len(lines) + len(objective.predictor.fitted_starts))
    runs = [run.about([*determined, *starts]) for run in runs]
    own: list[int] = []
    while len(own) < len(determined):
        left = [row for row in range(len(determined)) if row not in own]
        chances = [_chance(runs, [*own, row], len(starts)) for row in left]
        if min(chances) * len(left) > _LEVEL:
            break
        own.append(left[int(np.argmin(chances))])
    return _sentence(fit, [lines[determined[row]].name for row in own]) if own else None


def _chance(runs: list[_Run], own: list[int], initials: int) -> float:
    """p-value of the last parameter of `own` being equal in all runs; the others of `own` may differ between runs."""
    free, count = runs[0].scores.shape[1] - initials, len(runs)
    size = point_size(free, count, own, initials)
    at = [places(free, number, count, own, initials) for number in range(count)]
    information, gradient = np.zeros((size, size)), np.zeros(size)
    for run, mine in zip(runs, at, strict=True):
        information[np.ix_(mine, mine)] += run.information.sum(axis=0)
        gradient[mine] += run.scores.sum(axis=0)
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-12, hermitian=True)
    step = -(inverse @ (gradient / scale)) / scale
    last = [int(mine[own[-1]]) for mine in at]
    spread = np.zeros((count, count))
    for run, mine in zip(runs, at, strict=True):
        size_of = np.outer(scale[mine], scale[mine])
        for block, score in zip(run.information, run.scores, strict=True):
            left = (score + block @ step[mine]) / scale[mine]
            weight = np.eye(mine.size) - (block / size_of) @ inverse[np.ix_(mine, mine)]
            moved = inverse[np.ix_(np.array(last), mine)] @ np.linalg.lstsq(weight, left, rcond=1e-9)[0] / scale[last]
            spread += np.outer(moved, moved)
    scattering = np.flatnonzero([run.scatters(own[-1]) for run in runs])
    return _welch(step[last][scattering], spread[np.ix_(scattering, scattering)])


def _welch(values: Array, covariance: Array) -> float:
    """p-value of Welch's test for equal values (k,), with a covariance (k, k) that is estimated from a few blocks."""
    k = values.size
    if k < 2 or not np.all(np.diag(covariance) > 0.0):
        return 1.0
    contrast = np.eye(k)[1:] - np.eye(k)[:1]
    apart, spread = contrast @ values, contrast @ covariance @ contrast.T
    statistic = float(apart @ np.linalg.pinv(spread, hermitian=True) @ apart) / (k - 1)
    share = 1.0 / np.diag(covariance)
    loose = float(np.sum((1.0 - share / share.sum()) ** 2)) / (BLOCKS - 1)
    corrected = statistic / (1.0 + 2.0 * (k - 2) / (k**2 - 1) * loose)
    return float(fdtrc(k - 1, (k**2 - 1) / (3.0 * loose), corrected))


def farthest_apart(values: Array, std: Array) -> NDArray[np.intp]:
    """Indices of the two values (k,) that differ by the most standard errors, the lesser one first.

    The least and the greatest value may be those of two runs that hardly determine it.
    """
    apart = (values[None, :] - values[:, None]) / np.hypot(std[None, :], std[:, None])
    return np.asarray(np.unravel_index(int(np.argmax(apart)), apart.shape), dtype=np.intp)


def is_coefficient(model: ServoModel, name: str) -> bool:
    """Whether a parameter is a coefficient of a non-parametric curve, which means nothing by itself."""
    return any(isinstance(effect, Nonparametric) and name.startswith(f"{effect.name}.") for effect in model.effects)


def _sentence(fit: Fit, names: list[str]) -> str:
    """The values of each parameter in the runs, and the options that let it differ between runs."""
    apart = PerRun.of(fit, names)
    point = apart.minimise(apart.begun(fit), fit.bandwidth).point
    values, spread = apart.values(point), apart.covariance(point, fit.bandwidth)
    differing = []
    for column, name in enumerate(names):
        at = [int(apart.places(run)[apart.own[column]]) for run in range(len(fit.log.runs))]
        std = np.sqrt(np.diag(spread)[at])
        finite = np.flatnonzero(np.isfinite(std))
        if finite.size < 2:
            differing.append(name)
            continue
        low, high = finite[farthest_apart(values[finite, column], std[finite])]
        errors = (values[high, column] - values[low, column]) / float(np.hypot(std[low], std[high]))
        has = [f"{fit.log.runs[run].label} {measured(values[run, column], std[run])}" for run in (low, high)]
        differing.append(f"{name} ({has[0]}, {has[1]} {fit[name].unit}, {errors:.3g} standard errors apart)")
    listed = ", ".join(f"'{name}'" for name in names) + "," * (len(names) == 1)
    payload = "a payload per run (columns payload_mass and payload_radius, or payload_inertia), or "
    way = f"antidrive identify --per-run {','.join(names)} (in Python fit(log, per_run=({listed})))"
    return (
        f"The runs disagree about {' and '.join(differing)}: "
        f"{payload if {'inertia', 'gravity'} & set(names) else ''}{way} lets {'it' if len(names) == 1 else 'them'} "
        "differ from run to run."
    )
