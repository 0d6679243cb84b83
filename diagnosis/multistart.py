"""The best among similar shapes of an effect: a multimodal likelihood is maximised from several starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.refit import most_promising, problem_near
from identification.fit_result import Fit
from identification.threads import in_threads
from plant.effects import Effect

_PURSUED = 2  # number of starts from the whole range that are pursued to the end
_NEARER = (1, 2, 2, 2, 2, 2)  # stages of the local search, finer and finer; the last repeats while the fit improves
_FIRST_STEP = 2  # iterations after which starts are compared
_SMOOTHER = 0.2  # least observer bandwidth, as a share of that without the effect


def multistart_refit(fit: Fit, found: Fit, name: str) -> Fit:
    """The best fit with an added effect among its similar shapes; `fit` is without the effect, `found` with it.

    Then the fixed parameters of the effect are freed. If this improves the fit by more than the cost of the added
    parameters, the search is repeated.
    """
    best = best_similar_shape(fit, found, name)
    effect = best.model.effect(name)
    freer = () if effect is None else effect.freer()
    if not freer:
        return best
    (freed,) = _optimised(fit, best, name, freer, most=1)
    pays = 0.5 * (len(freed.free) - len(best.free)) * float(np.log(fit.samples)) + float(np.log(len(freer)))
    return best_similar_shape(fit, freed, name) if _height(freed) > _height(best) + pays else best


def best_similar_shape(fit: Fit, found: Fit, name: str) -> Fit:
    """The same without freeing fixed parameters.

    The two best starts from the whole range are pursued: only at the end it is clear which maximum is higher.
    """
    distant = _optimised(fit, found, name, _similar_shapes(found, name, stage=0), most=_PURSUED)
    starts = sorted((found, *distant), key=_height)[-_PURSUED:]
    return max(in_threads(lambda way: _nearer(fit, way, name), starts), key=_height)


def _nearer(fit: Fit, best: Fit, name: str) -> Fit:
    for stage in _NEARER:
        better = _optimised(fit, best, name, _similar_shapes(best, name, stage), most=1)
        if better and _height(better[0]) > _height(best):
            (best,) = better
        elif stage == _NEARER[-1]:
            break
    return best


def _height(fit: Fit) -> float:
    """Log-likelihood of a fit; for a chaotic model its mean with that of an observer that stabilises the prediction.

    The height of a maximum in free simulation depends on chance; with the observer the maximum is smooth but flat.
    """
    held = fit.held_log_likelihood
    return fit.log_likelihood if held is None else 0.5 * (fit.log_likelihood + held)


def _similar_shapes(fit: Fit, name: str, stage: int) -> tuple[Effect, ...]:
    effect = fit.model.effect(name)
    return () if effect is None else effect.similar_shapes(stage)


def _optimised(fit: Fit, best: Fit, name: str, others: Sequence[Effect], *, most: int) -> list[Fit]:
    """Fits from the best of other shapes of an effect, if there are any, at the bandwidth of the best fit so far.

    With the faster observer of the model without the effect, fine details are lost and the maximum reached is random.
    """
    rest = best.model.without_effect(name)
    at = max(best.bandwidth, _SMOOTHER * fit.bandwidth)
    near = replace(best, model=rest, initial=best.initial_of(rest), bandwidth=at)
    similar = [problem_near(fit, rest.with_effect(other)) for other in others]
    return in_threads(lambda each: each.descend(near), most_promising(similar, near, at, _FIRST_STEP)[:most])
