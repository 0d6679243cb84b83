"""How unevenly a log speaks for an effect: what a model lacks makes its parts disagree by more than noise does.

Evidence then counts for less than it seems, by as much as the scatter between the parts widens the variance of the
effect's parameters (clustered standard errors, Liang and Zeger 1986; of a likelihood ratio, Satorra and Bentler 1994).
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from diagnosis.nuisance import Nuisance, basis
from diagnosis.refit import problem_near
from identification.fit_result import Fit

_PARTS = 10
_BY_CHANCE = 0.95
_ELSEWHERE = 0.1  # share of what shows an effect that must not lie in one part; there it has none to disagree with


class Overdispersion(NamedTuple):
    """How much ten parts of a log disagree about an effect.

    Attributes:
        factor: by which they disagree more than white noise would on average, at least 1.
        least: by which they do more than white noise would in 19 of 20 cases, at least 1. Where few parts show the
            effect that is much less: chance alone makes two of them disagree by a factor of three.
    """

    factor: float
    least: float


def overdispersion(fit: Fit, name: str) -> Overdispersion:
    """How much ten parts of the log disagree about a fitted effect."""
    problem = problem_near(fit, fit.model)
    places = [row for row, place in enumerate(problem.free) if fit.model.names[place].startswith(f"{name}.")]
    predictions = problem.predictor.predict(fit.model.values, fit.initial, bandwidth=fit.bandwidth, width=0.0)
    innovations = np.concatenate([p.innovations for p in predictions])
    rest = Nuisance.of([replace(p, jacobian=np.delete(p.jacobian, places, axis=1)) for p in predictions])
    directions = basis(rest.beyond(np.vstack([p.jacobian[:, places] for p in predictions])))
    followed = np.hstack((rest.shared, directions))
    apart, by_noise = 0.0, list[float]()
    parts = [np.array_split(values, _PARTS) for values in (innovations, directions, followed)]
    for left, own, by_fit in zip(*parts, strict=True):
        apart += float(((own.T @ left) ** 2).sum())
        # of white noise less what the fit has followed of it
        by_noise.append(float((own**2).sum() - ((own.T @ by_fit) ** 2).sum()))
    expected = sum(by_noise)
    if expected < _ELSEWHERE * directions.shape[1] or not directions.size:
        return Overdispersion(factor=1.0, least=1.0)
    factor = apart / (expected * float(np.mean(innovations**2)))
    # Parts that say little of the effect hardly count (Satterthwaite 1946); each has as many terms as directions.
    terms = directions.shape[1] * expected**2 / sum(value**2 for value in by_noise)
    return Overdispersion(factor=max(factor, 1.0), least=max(factor * terms / float(chi2.ppf(_BY_CHANCE, terms)), 1.0))
