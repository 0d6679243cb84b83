"""How unevenly a log speaks for an effect: what a model lacks makes its parts disagree by more than noise does.

Evidence then counts for less than it seems, by as much as the scatter between the parts widens the variance of the
effect's parameters (clustered standard errors, Liang and Zeger 1986; of a likelihood ratio, Satorra and Bentler 1994).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from diagnosis.nuisance import Nuisance, basis
from diagnosis.refit import problem_near
from identification.fit_result import Fit

_PARTS = 10
_ELSEWHERE = 0.1  # share of what shows an effect that must not lie in one part; there it has none to disagree with


def unevenness(fit: Fit, name: str) -> float:
    """Factor by which ten parts of the log disagree more about a fitted effect than white noise would, at least 1."""
    problem = problem_near(fit, fit.model)
    places = [row for row, place in enumerate(problem.free) if fit.model.names[place].startswith(f"{name}.")]
    predictions = problem.predictor.predict(fit.model.values, fit.initial, bandwidth=fit.bandwidth, width=0.0)
    innovations = np.concatenate([p.innovations for p in predictions])
    rest = Nuisance.of([replace(p, jacobian=np.delete(p.jacobian, places, axis=1)) for p in predictions])
    directions = basis(rest.beyond(np.vstack([p.jacobian[:, places] for p in predictions])))
    followed = np.hstack((rest.shared, directions))
    apart = by_noise = 0.0
    parts = [np.array_split(values, _PARTS) for values in (innovations, directions, followed)]
    for left, own, by_fit in zip(*parts, strict=True):
        apart += float(((own.T @ left) ** 2).sum())
        # of white noise less what the fit has followed of it
        by_noise += float((own**2).sum() - ((own.T @ by_fit) ** 2).sum())
    if by_noise < _ELSEWHERE * directions.shape[1] or not directions.size:
        return 1.0
    return max(apart / (by_noise * float(np.mean(innovations**2))), 1.0)
