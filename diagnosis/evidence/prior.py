"""What is thought of an effect's parameters before a log is seen.

A size, a time constant or an order may lie anywhere within three decades, each decade as likely as the next: the
density is 1 / (value ln 1000). So no unit and no scale of the machine takes part. Where on the log's clock, the travel
or the turn something lies is as likely anywhere.
"""

from __future__ import annotations

import numpy as np

from identification.fit_result import Fit
from plant.effects import Effect
from plant.effects.nonparametric_curve import Nonparametric

_DECADES = float(np.log(1000.0))
LOG_UNIFORM = float(np.log(_DECADES / np.sqrt(2.0 * np.pi)))
"""What a size costs that is known to a standard error as large as itself."""


def forms(kind: type[Effect]) -> int:
    """What an effect counts as: one that has a simpler one as its special case counts as that and one more.

    So Stribeck friction is no likelier before than Coulomb friction with something beside it. What has no name has
    names as special cases.
    """
    return 1 if kind.reduced is Effect.reduced and not issubclass(kind, Nonparametric) else 2


def log_density(fit: Fit, name: str, std: float) -> float:
    """Of a fitted parameter `effect.parameter` at its value; its standard error blurs it."""
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
