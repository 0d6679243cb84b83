"""Prior density of an effect's parameters.

A size, a time constant or an order is log-uniform over three decades: the density is 1 / (value ln 1000). So the prior
depends on no unit and no scale of the machine. An instant is uniform over the log, an angle or position over the range
of travel, a phase over the turn.
"""

from __future__ import annotations

import numpy as np

from identification.fit_result import Fit
from plant.effects import Effect
from plant.effects.nonparametric_curve import Nonparametric

_DECADES = float(np.log(1000.0))
LOG_UNIFORM = float(np.log(_DECADES / np.sqrt(2.0 * np.pi)))
"""Prior cost of a size whose standard error is as large as itself."""


def forms(kind: type[Effect]) -> int:
    """Number of effects that an effect counts as in the penalty: two if it has a simpler special case, else one.

    So Stribeck friction has the prior probability of Coulomb friction with one more effect. A non-parametric effect
    has catalogue effects as special cases and counts twice.
    """
    return 1 if kind.reduced is Effect.reduced and not issubclass(kind, Nonparametric) else 2


def log_density(fit: Fit, name: str, std: float) -> float:
    """Log prior density of a parameter `effect.parameter` at its estimate, or at its standard error if larger."""
    place = fit.model.names.index(name)
    spec, value = fit.model.parameters[place], abs(float(fit.model.values[place]))
    runs = fit.log.runs
    if spec.instant:
        return -float(np.log(max(run.time[-1] for run in runs) - min(run.time[0] for run in runs)))
    if spec.lower < 0.0 and spec.unit == "rad" and name.endswith("phase"):
        return -float(np.log(2.0 * np.pi))
    if spec.lower < 0.0 and spec.unit in ("rad", "m"):
        angles = np.concatenate([run.output[run.valid] for run in runs])
        return -float(np.log(max(float(np.ptp(angles)), 1e-300)))
    sides = 2.0 if spec.lower < 0.0 else 1.0
    return -float(np.log(sides * _DECADES * max(value, std, 1e-300)))
