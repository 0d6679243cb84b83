"""The colour of the reading's noise: filters in an encoder or a drive make neighbouring readings err alike.

Without it, an observer takes slow noise for motion and follows it. The noise counts as coloured where a short
autoregression of a free simulation's errors explains the log clearly better than an observer does. From then on the log
carries a colour, and every fit of it finds its own (generalised least squares; Cochrane and Orcutt 1949).
"""

from __future__ import annotations

from identification.fit_result import Fit
from identification.noise import autoregression
from identification.problem import Problem

_CLEARLY = 10.0  # rise of the log-likelihood from which a colour is believed


def with_its_colour(fit: Fit) -> Fit:
    """The same model fitted to the log with the colour of its reading's noise, or the fit as it is."""
    free = Problem.of(fit.log, fit.model, fixed=fit.fixed).solve(free=True) if fit.bandwidth else fit
    if free.bandwidth or not autoregression(free.innovations).size:
        return fit
    coloured = Problem.of(fit.log, free.model, fixed=fit.fixed).recoloured(free)
    return coloured if coloured.log_likelihood > fit.log_likelihood + _CLEARLY else fit
