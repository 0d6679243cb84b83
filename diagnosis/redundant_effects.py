"""Whether the effects that were named are still needed beside the curves that were added to them.

The search knows what no effect explains as a discrepancy, which is linearised. If that is large, an effect elsewhere in
the servo may seem to explain what the linearisation misses: an error of the encoder beside a torque that ripples. The
curves are fitted exactly. So an effect of the sensor, the actuator or the load is ruled out if it gains nothing beside
a curve at another of these places. At the same place a curve can replace any effect, which says nothing.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from diagnosis.evidence.marginal import Explanation
from diagnosis.falsification import Tenable, tenable
from diagnosis.multimodal_likelihood import on_its_best_peak
from diagnosis.nonparametric_residual import with_curves
from diagnosis.refit import settled, without
from identification.fit_result import Fit
from identification.log import Log
from plant.effects import Effect
from plant.effects.effect import Stage
from plant.effects.nonparametric_curve import Nonparametric


def beside_curves(
    base: Fit, explanations: Collection[Explanation], found: Tenable, held_out: Log
) -> tuple[Tenable, Fit]:
    """The leading set without effects that gain nothing beside the curves added to it, and the fit with the curves.

    Args:
        base: fit of the base model.
        explanations: all fitted sets, with each observer.
        found: those that are not ruled out.
        held_out: validation data.
    """
    ruled_out = dict[str, str]()
    while True:
        found = replace(
            found, fit=on_its_best_peak(found.fit, found.without), falsified={**found.falsified, **ruled_out}
        )
        final = with_curves(found.fit, base)
        curves = [effect for effect in final.model.effects if found.fit.model.effect(effect.name) is None]
        effect = _needless(found.fit, final, base, {curve.stage for curve in curves}) if curves else None
        explanations = [each for each in explanations if effect is None or effect.name not in each.names]
        if effect is None or not explanations:
            return found, final
        ruled_out[effect.name] = f"it explains nothing beside a {curves[0].title}"
        found = tenable(base, explanations, held_out)


def _needless(named: Fit, final: Fit, base: Fit, places: Collection[Stage]) -> Effect | None:
    """An effect outside the `places` of the curves that gains less beside them than its parameters cost; or None."""
    added = [effect for effect in named.model.effects if not base.model.holds(effect.name)]
    asked = [effect for effect in added if effect.stage not in places and not isinstance(effect, Nonparametric)]
    whole = settled(final, base.bandwidth) if asked else final
    for effect in asked:
        less = without(final, effect.name, base.bandwidth)
        cost = 0.5 * (len(whole.free) - len(less.free)) * float(np.log(final.samples))
        if less.converged and whole.log_likelihood - less.log_likelihood < cost:
            return effect
    return None
