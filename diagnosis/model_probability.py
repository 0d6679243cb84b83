"""Odds: from the likelihoods of rival explanations to probabilities, in two questions.

*Is anything missing?* An effect worth asking for is just visible or larger: before the log is seen, each of its
parameters is expected to be worth about `_VISIBLE` in lambda, twice the log-likelihood (Zellner's g-prior with g that).
*And what is it?* Among the names, what a parameter costs lies half-way between that and the share of its plausible
range that the estimate still leaves open (Laplace), which is at most half a log(samples) (Schwarz 1978): by the latter
alone the simpler law would win too often where an effect is barely visible, by the former too seldom where it is plain.
In both questions the catalogue costs the log of its number, and so does a search over shapes: that is what a flat prior
says, and enough for the peaks of white noise (extended BIC, Chen and Chen 2008). The peaks of what no model has right
are higher: as many times as a found shape's neighbours explain more than chance would, as many times its search is
charged; twice where nobody can tell.

The probability of a name is that something is missing, times the name's share among the names.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from identification.fit_result import Fit
from plant.effects.effect import Array

NONE = "none"
SEEN = 0.8  # probability from which it is told that something is missing at all
CLEAR = 0.9  # ... from which a name stands alone, and from which one is added to what was found before
_VISIBLE = 50.0  # lambda for each parameter that an effect is expected to have before the log is seen
_SCALES = 9  # sizes of a curve that are tried
_LATE = 20.0  # samples by which a servo may plausibly be late
UNKNOWN = 2.0  # times that a search is charged whose neighbourhood is not known


def search_charge(*, searched: int, catalogue: int, peaks: float | None = None) -> float:
    """What an explanation pays for having been searched for: `searched` shapes inside it, among `catalogue` rivals.

    Args:
        searched: number of shapes.
        catalogue: number of rivals.
        peaks: how much higher than chance's the peaks beside the shape are, if that is known.
    """
    times = UNKNOWN if peaks is None else max(peaks, 1.0)
    return times * float(np.log(searched)) + float(np.log(max(catalogue, 1)))


def schwarz_cost(parameters: int, samples: int) -> float:
    """Half a log(samples) for each parameter."""
    return 0.5 * parameters * float(np.log(samples))


def parameter_cost(fit: Fit, than: Fit) -> float:
    """Cost of the parameters that a fit has more than another: Laplace's, at most Schwarz's."""
    more = [row for row, place in enumerate(fit.free) if fit.model.names[place] not in than.model.names]
    fewer = sum(name not in fit.model.names for name in than.model.names)
    schwarz = schwarz_cost(len(more) - fewer, fit.samples)
    ranges = [plausible_range(fit.model.quantities[fit.free[row]], fit) for row in more]
    settled = all(fit.parameters[fit.free[row]].std and not fit.parameters[fit.free[row]].at_bound for row in more)
    if fewer or not settled or any(r is None for r in ranges):
        return schwarz
    sign, volume = np.linalg.slogdet(2.0 * np.pi * fit.covariance[np.ix_(more, more)])
    if sign <= 0.0:
        return schwarz
    laplace = float(np.sum(np.log(np.array(ranges, dtype=float))) - 0.5 * volume)
    return min(schwarz, max(laplace, 0.0))


def smooth_evidence(information: Array, pull: Array, prior: Array) -> tuple[float, Array]:
    """Log Bayes factor of a smooth curve against none, and the curve.

    The coefficients have a Gaussian prior of a given shape, whose size is taken at its best of a few and charged for
    (MacKay 1992). A curve so pays for the bends that it uses and not for the knots that it has.

    Args:
        information: (m, m) R'R over the variance of the values to explain, y, with R and y what no other parameters
            absorb.
        pull: (m,) R'y over that variance.
        prior: (m, m) covariance up to a factor.
    """
    root = np.linalg.cholesky(prior)
    eigenvalues, vectors = np.linalg.eigh(root.T @ information @ root)
    eigenvalues, along = np.maximum(eigenvalues, 0.0), vectors.T @ (root.T @ pull)
    top = float(eigenvalues.max(initial=0.0))
    if top <= 0.0:
        return 0.0, np.zeros(pull.size)
    found = []
    for size in np.geomspace(1.0, 1e8, _SCALES) / top:
        stiff = 1.0 + size * eigenvalues
        found.append((0.5 * float(np.sum(size * along**2 / stiff) - np.sum(np.log(stiff))), size))
    best, size = max(found)
    curve = root @ (vectors @ (size * along / (1.0 + size * eigenvalues)))
    return best - float(np.log(_SCALES)), np.asarray(curve)


def typical_speed(fit: Fit) -> float:
    """Speed that the log exceeds a tenth of the time [rad/s]."""
    speed = np.concatenate([np.diff(run.output) / np.diff(run.time) for run in fit.log.runs])
    return float(np.quantile(np.abs(speed), 0.9))


def plausible_range(quantity: str, fit: Fit) -> float | None:
    """How far a parameter of that kind (`ServoModel.quantities`) may plausibly reach on this log.

    None where the search itself is the range.
    """
    torque = np.concatenate([run.drive for run in fit.log.runs])
    level = float(np.sqrt(np.mean(torque**2)))
    fast = typical_speed(fit)
    force, length = {"rotary": ("N m", "rad"), "linear": ("N", "m")}[fit.log.axis]
    return {
        force: level,
        "s": _LATE * fit.log.sample_time,
        f"{length}/s": fast,
        f"{force} s/{length}": level / fast,
        f"{force} s^2/{length}^2": level / fast**2,
    }.get(quantity)


def visibility_cost(parameters: int) -> float:
    """Cost of parameters in the question whether anything is missing at all."""
    return 0.5 * parameters * float(np.log1p(_VISIBLE))


def probabilities(scores: Mapping[str, float], visible: Mapping[str, float]) -> dict[str, float]:
    """Probability of each explanation and of none, the likeliest first.

    Args:
        scores: of each name, in the question which it is.
        visible: of each name, in the question whether anything is missing.
    """
    if not scores:
        return {NONE: 1.0}
    missing = float(np.exp(-np.logaddexp(0.0, -np.logaddexp.reduce(list(visible.values())))))
    values = np.array(list(scores.values()))
    best = values.max()
    weights = np.exp(values - best) if np.isfinite(best) else np.ones(values.size)
    shares = dict(zip(scores, missing * weights / weights.sum(), strict=True)) | {NONE: 1.0 - missing}
    return {name: float(shares[name]) for name in sorted(shares, key=lambda name: -shares[name])}
