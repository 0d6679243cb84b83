"""The best among shapes of an effect that look alike: a likelihood with many peaks is climbed from several places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.refit import most_promising, problem_near
from identification.fit_result import Fit
from identification.threads import in_threads
from plant.effects import Effect

_WAYS = 2  # from all over the range, that are followed to the end
_NEARER = (1, 2, 2, 2, 2, 2)  # stages of a search near by, ever finer; the finest as long as it finds better shapes
_FIRST_STEP = 2  # evaluations after which shapes are compared: where they are, and one step on
_SMOOTHER = 0.2  # of the bandwidth before, below which a multimodal likelihood is not looked at from afar


def multistart_refit(fit: Fit, found: Fit, name: str) -> Fit:
    """What a refit of a fit with one effect more found, or better: the best among the shapes that look alike.

    Then what the effect states is fitted too; where that fits clearly better all is searched anew.
    """
    best = best_similar_shape(fit, found, name)
    effect = best.model.effect(name)
    freer = () if effect is None else effect.freer()
    if not freer:
        return best
    (freed,) = _climbed(fit, best, name, freer, most=1)
    pays = 0.5 * (len(freed.free) - len(best.free)) * float(np.log(fit.samples)) + float(np.log(len(freer)))
    return best_similar_shape(fit, freed, name) if _height(freed) > _height(best) + pays else best


def best_similar_shape(fit: Fit, found: Fit, name: str) -> Fit:
    """The same with what the effect states as it is.

    Two ways are followed from all over the range: only at its end is seen which of them leads up the higher peak.
    """
    afar = _climbed(fit, found, name, _similar_shapes(found, name, stage=0), most=_WAYS)
    ways = sorted((found, *afar), key=_height)[-_WAYS:]
    return max(in_threads(lambda way: _nearer(fit, way, name), ways), key=_height)


def _nearer(fit: Fit, best: Fit, name: str) -> Fit:
    for stage in _NEARER:
        better = _climbed(fit, best, name, _similar_shapes(best, name, stage), most=1)
        if better and _height(better[0]) > _height(best):
            (best,) = better
        elif stage == _NEARER[-1]:
            break
    return best


def _height(fit: Fit) -> float:
    """Of a peak: where the likelihood is multimodal, half of it as seen behind an observer that makes it smooth.

    There the peak of a free simulation is as high as chance will have it, and the smooth one is blunt.
    """
    held = fit.held_log_likelihood
    return fit.log_likelihood if held is None else 0.5 * (fit.log_likelihood + held)


def _similar_shapes(fit: Fit, name: str, stage: int) -> tuple[Effect, ...]:
    effect = fit.model.effect(name)
    return () if effect is None else effect.similar_shapes(stage)


def _climbed(fit: Fit, best: Fit, name: str, others: Sequence[Effect], *, most: int) -> list[Fit]:
    """From the most promising of other shapes of an effect, if there are any: at the bandwidth of the best so far.

    Behind the observer of the model without the effect a fine shape is forgotten, and which peak is climbed is chance.
    """
    rest = best.model.without_effect(name)
    at = max(best.bandwidth, _SMOOTHER * fit.bandwidth)
    near = replace(best, model=rest, bandwidth=at)
    alike = [problem_near(fit, rest.with_effect(other)) for other in others]
    return in_threads(lambda each: each.descend(near), most_promising(alike, near, at, _FIRST_STEP)[:most])
