"""The model that describes a log best, also where none of its effects can be named.

If the unmodelled torque is large, every effect may be a part of it; if several sets explain a log equally well, none
of them is sure. A model with them may still predict better than one without any.
"""

from __future__ import annotations

import numpy as np

from diagnosis.evidence.posterior import Posterior
from diagnosis.falsification import errors_of_many_steps
from diagnosis.holdout import cut
from diagnosis.levels import SIGNIFICANT
from diagnosis.refit import settled
from identification.fit_result import Fit
from identification.log import Log


def likeliest(posterior: Posterior, base: Fit) -> Fit:
    """The fit of the set with the most evidence, with the observer that it needs without a discrepancy."""
    first = posterior.sets[0]
    return settled(first.fit, base.bandwidth) if first.names else base


def better_description(fit: Fit, described: Fit, held_out: Log) -> bool:
    """Whether another model explains a log better than a fit, and predicts validation data significantly better.

    Each added parameter costs 1/2 log(samples) (Schwarz 1978). One step ahead alone, with a fast observer, nearly any
    model predicts well.
    """
    cost = 0.5 * (len(described.free) - len(fit.free)) * float(np.log(fit.samples))
    if described is fit or described.log_likelihood - fit.log_likelihood <= cost:
        return False
    return _predicts_better(fit, described, held_out)


def worse_description(base: Fit, fit: Fit, held_out: Log) -> bool:
    """Whether a fit predicts validation data significantly worse than the base model; then it describes nothing."""
    return fit is not base and _predicts_better(fit, base, held_out)


def _predicts_better(fit: Fit, other: Fit, held_out: Log) -> bool:
    gain, std = cut(*(errors_of_many_steps(each.model, held_out) for each in (fit, other)))
    return gain > SIGNIFICANT * std
