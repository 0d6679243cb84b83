"""Limit of detection: the size at which an effect would be detected in a log from which no effect is missing.

The coefficient of an effect's signature, beyond all directions that the fit can absorb, has a standard error s. An
effect of size z s then has a log Bayes factor of z^2 / 2 on average, less two costs: its log-uniform prior over three
decades (`evidence.prior`), and the number of candidates. The limit is given only for effects with a single signature
and with their size as the only parameter; for these it is exact to first order.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from diagnosis.evidence.prior import LOG_UNIFORM
from diagnosis.levels import CLEARLY
from diagnosis.linear import response
from diagnosis.result import Estimate
from diagnosis.score_test import Screen
from identification.fit_result import Fit
from plant.effects import Regressors, catalogue

_LARGE = 100.0  # standard errors; every effect of this size is detected


def detectable(fit: Fit, candidates: Collection[str]) -> dict[str, Estimate]:
    """Size at which each effect would be detected with a probability of 0.5, by name; other effects are left out.

    Args:
        fit: from which no effect is missing.
        candidates: the candidate effects.
    """
    screen = Screen.of(fit)
    found: dict[str, Estimate] = {}
    for name in candidates:
        kind = catalogue.get(name)
        specs = () if kind is None else kind.parameters()
        shapes = list(kind.regressors(screen.motion)) if kind is not None else []
        if len(specs) != 1 or len(shapes) != 1 or shapes[0].columns.shape[1] != 1:
            continue
        (spec,) = specs
        size = _standard_error(screen, shapes[0]) * _noticed(2 if spec.lower < 0.0 else 1, len(candidates))
        found[name] = Estimate(value=size, std=None, unit=spec.unit_on(fit.model.axis, fit.model.torque_unit))
    return found


def _noticed(sides: int, catalogue: int) -> float:
    """Size in standard errors at which the log Bayes factor is `CLEARLY`."""

    def over(z: float) -> float:
        return float(0.5 * z**2 - np.log(sides * z) - LOG_UNIFORM - np.log(catalogue) - CLEARLY)

    from scipy.optimize import brentq

    return float(brentq(over, 1.0, _LARGE))


def _standard_error(screen: Screen, regressors: Regressors) -> float:
    """Standard error of the signature's coefficient."""
    on_measurement = regressors.acts_on == "measurement"
    seen = screen.nuisance.beyond(response(screen.filters, regressors.columns, on_measurement=on_measurement))
    information = float((seen**2).sum())
    return screen.fit.noise_std / float(np.sqrt(information)) if information > 0.0 else np.inf
