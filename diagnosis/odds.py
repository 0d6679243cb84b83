"""Odds: from the likelihoods of rival explanations to probabilities.

An explanation's score is its rise in log-likelihood over the model at hand, less what its parameters cost, twice the
log of the number of shapes that were searched for it, and the log of the number of rivals in the catalogue (extended
BIC, Chen and Chen 2008). Odds are the exponentials of scores; "none of them" has score 0.

What parameters cost: by Laplace's method the share of the plausible range that the estimate still leaves open, but at
most half a log(samples) each (Schwarz 1978). The first keeps a richer rival in the race where the data say little.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from identification.fit_result import Fit
from plant.effects.effect import Array

NONE = "none"
CLEAR = 0.9  # probability above which a name stands alone
MISSING = 0.99  # probability of "something is missing" that a name needs
_SCALES = 9  # sizes of a curve that are tried


def search_charge(*, searched: int, catalogue: int) -> float:
    """What an explanation pays for having been searched for: `searched` shapes inside it, among `catalogue` rivals."""
    return 2.0 * float(np.log(searched)) + float(np.log(max(catalogue, 1)))


def schwarz_cost(parameters: int, samples: int) -> float:
    """Half a log(samples) for each parameter."""
    return 0.5 * parameters * float(np.log(samples))


def parameter_cost(fit: Fit, than: Fit) -> float:
    """Cost of the parameters that a fit has more than another: Laplace's, at most Schwarz's."""
    more = [row for row, place in enumerate(fit.free) if fit.model.names[place] not in than.model.names]
    fewer = sum(name not in fit.model.names for name in than.model.names)
    schwarz = schwarz_cost(len(more) - fewer, fit.samples)
    ranges = [plausible_range(fit.model.parameters[fit.free[row]].unit, fit) for row in more]
    settled = all(fit.parameters[fit.free[row]].std and not fit.parameters[fit.free[row]].at_bound for row in more)
    if fewer or not settled or any(r is None for r in ranges):
        return schwarz
    sign, volume = np.linalg.slogdet(2.0 * np.pi * fit.covariance[np.ix_(more, more)])
    if sign <= 0.0:
        return schwarz
    laplace = float(np.sum(np.log(np.array(ranges, dtype=float))) - 0.5 * volume)
    return min(schwarz, max(laplace, 0.0))


def smooth_evidence(regressors: Array, values: Array, prior: Array) -> tuple[float, Array]:
    """Log Bayes factor of a smooth curve against none, and the curve.

    The coefficients have a Gaussian prior of a given shape, whose size is taken at its best of a few and charged for
    (MacKay 1992). A curve so pays for the bends that it uses and not for the knots that it has.

    Args:
        regressors: (T, m) with everything projected out that other parameters absorb.
        values: (T,) to explain, likewise.
        prior: (m, m) covariance up to a factor.
    """
    root = np.linalg.cholesky(prior)
    variance = float(np.mean(values**2))
    seen = regressors @ root
    information, pull = seen.T @ seen / variance, seen.T @ values / variance
    eigenvalues, vectors = np.linalg.eigh(information)
    eigenvalues, along = np.maximum(eigenvalues, 0.0), vectors.T @ pull
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


def plausible_range(unit: str, fit: Fit) -> float | None:
    """How far a parameter of that unit may plausibly reach on this log; None where the search itself is the range."""
    torque = np.concatenate([run.command - run.servo_gain * run.output for run in fit.log.runs])
    level = float(np.sqrt(np.mean(torque**2)))
    fast = typical_speed(fit)
    return {
        "N m": level,
        "N": level,
        "s": 0.1,
        "rad/s": fast,
        "m/s": fast,
        "N m s/rad": level / fast,
        "N s/m": level / fast,
        "N m s^2/rad^2": level / fast**2,
        "N s^2/m^2": level / fast**2,
    }.get(unit)


def probabilities(scores: Mapping[str, float]) -> dict[str, float]:
    """Probability of each explanation and of none, the likeliest first."""
    names = [*scores, NONE]
    values = np.array([*scores.values(), 0.0])
    weights = np.exp(values - values.max())
    shares = weights / weights.sum()
    order = np.argsort(-shares, kind="stable")
    return {names[i]: float(shares[i]) for i in order}
