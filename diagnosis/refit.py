"""Fits of a model with one effect more, and what they are worth."""

from __future__ import annotations

import numpy as np

from diagnosis.odds import typical_speed
from diagnosis.result import Estimate
from identification.fit_result import Fit
from identification.problem import Problem
from plant.effects import Effect

_DESCENTS = 2  # starts of one effect that are followed to the end


def refit(fit: Fit, *starts: Effect, fixed: tuple[str, ...] = ()) -> Fit:
    """Fit the model with one effect more, from where the screen says it is: from the starts that get on best."""
    models = [fit.model.with_effect(start) for start in starts]
    kept = [name for name in (*fit.fixed, *fixed) if name in models[0].names]
    problems = [Problem.of(fit.log, model, fixed=kept) for model in models]
    if len(problems) > _DESCENTS:
        problems = sorted(problems, key=lambda problem: problem.glance(fit))[:_DESCENTS]
    return max((problem.descend(fit) for problem in problems), key=lambda found: found.log_likelihood)


def evidence_of(fit: Fit, than: Fit) -> float:
    """By how much a fit is likelier than a simpler one, each less its charge for a bandwidth.

    Where innovations have a colour, a likelihood ratio counts too much. It is divided by the factor by which the colour
    widens the variance of the parameters that the fit has more (the scaled likelihood ratio of Satorra and Bentler).
    """
    charge = 0.5 * float(np.log(fit.samples))
    rise = fit.log_likelihood - than.log_likelihood - charge * ((fit.bandwidth > 0.0) - (than.bandwidth > 0.0))
    more = [row for row, place in enumerate(fit.free) if fit.model.names[place] not in than.model.names]
    if not more or rise <= 0.0:
        return rise
    coloured, white = (np.diag(table)[more] for table in (fit.covariance, fit.white_covariance))
    known = white > 0.0
    widening = float(np.exp(np.mean(np.log(coloured[known] / white[known])))) if known.any() else 1.0
    return rise / max(widening, 1.0)


def estimates(fit: Fit, effect: str) -> dict[str, Estimate]:
    """The estimates of one effect's parameters."""
    own = fit.model.effect(effect)
    if own is None:
        return {}
    lines = {spec.name: fit[f"{effect}.{spec.name}"] for spec in own.parameters()}
    return {
        name: Estimate(value=float(getattr(own, name)), std=line.std, unit=line.unit) for name, line in lines.items()
    }


def is_its_special_case(fit: Fit, name: str) -> bool:
    """Whether the shape of a fitted effect vanishes, so that nothing shows what a special case would not show too."""
    effect = fit.model.effect(name)
    return effect is not None and bool(effect.reduced()) and effect.vanishes(typical_speed(fit))
