"""Odds: from the likelihoods of rival explanations to probabilities.

An explanation's score is its rise in log-likelihood over the model at hand, less half a log(samples) for each parameter
more (Schwarz 1978), the log of the number of shapes that were searched for it, and the log of the number of rivals that
the catalogue holds (extended BIC, Chen and Chen 2008). Odds are the exponentials of scores; "none of them" has score 0.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

NONE = "none"
CLEAR = 0.9  # probability above which a name stands alone
MISSING = 0.99  # probability of "something is missing" that a name needs


def score(evidence: float, *, parameters: int, samples: int, searched: int, catalogue: int) -> float:
    """Penalised evidence of one explanation.

    Args:
        evidence: rise of the log-likelihood.
        parameters: how many more it has than the model at hand.
        samples: in the log.
        searched: shapes that were compared inside the explanation.
        catalogue: explanations that were asked for.
    """
    return evidence - 0.5 * parameters * np.log(samples) - np.log(searched) - np.log(max(catalogue, 1))


def probabilities(scores: Mapping[str, float]) -> dict[str, float]:
    """Probability of each explanation and of none, the likeliest first."""
    names = [*scores, NONE]
    values = np.array([*scores.values(), 0.0])
    weights = np.exp(values - values.max())
    shares = weights / weights.sum()
    order = np.argsort(-shares, kind="stable")
    return {names[i]: float(shares[i]) for i in order}
