"""What remains of names once the load may wander: a slow random torque looks like many a small effect for a while.

Where a model is complete, nothing is left for an observer to do. Where a slow one is needed to the end, each name has
to beat a load that wanders in its place. With enough names any wander is imitated, but it does not go on as they do:
several that take a slow observer's place must not lose more where they are not fitted than they have gained, unless for
what the rest leaves open of their parameters. An observer nearly as fast as the sampling follows anything, and says
nothing of slow loads.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.special import expit

from diagnosis.model_probability import CLEAR, NONE
from diagnosis.predictive_likelihood import log_likelihood_by_sample, predictive_loss
from diagnosis.refit import evidence_of, fitted_near, follows_anything
from diagnosis.stepwise_round import Addition
from identification.fit_result import Fit
from plant.effects.random_walk_load import RandomWalkLoad

_SEVERAL = 3  # names


def may_be_random_walk(fit: Fit) -> bool:
    """Whether a slow observer is needed, as it is where the load torque wanders."""
    return fit.bandwidth > 0.0 and not follows_anything(fit)


def with_random_walk(fit: Fit) -> Fit:
    """The fit with a load torque that wanders at random."""
    return fitted_near(fit, fit.model.with_effect(RandomWalkLoad()))


def without_random_walk_artefacts(
    base: Fit, additions: list[Addition], progress: Callable[[str], None] | None
) -> list[Addition]:
    """The additions that still pay if the load may wander, fitted anew where one had to go."""
    final = additions[-1].fit if additions else base
    if len(additions) >= _SEVERAL and may_be_random_walk(base) and _breaks_off(base, final):
        return []
    if not may_be_random_walk(final):
        return additions
    if progress is not None:
        progress("comparing with a random-walk disturbance torque")
    needed = {addition.effect: 1.0 for addition in additions}
    beside = with_random_walk(final)
    at_hand = max(final, beside, key=lambda fit: fit.log_likelihood)
    for addition in sorted(additions, key=lambda addition: addition.evidence):
        less = fitted_near(at_hand, at_hand.model.without_effect(addition.effect).with_effect(RandomWalkLoad()))
        needed[addition.effect] = probability_needed(addition, at_hand, less)
        if needed[addition.effect] < CLEAR:
            at_hand = less
    sure = [(addition, needed[addition.effect]) for addition in additions]
    kept = [with_lower_probability(addition, probability) for addition, probability in sure if probability >= CLEAR]
    return kept if len(kept) == len(additions) else refitted_path(base, kept, final)


def _breaks_off(base: Fit, final: Fit) -> bool:
    """Whether what a model explains more than another does not go on, nor is it for want of having been seen."""
    lost = float(
        np.sum(log_likelihood_by_sample(base, base.bandwidth) - log_likelihood_by_sample(final, final.bandwidth))
    )
    return lost > evidence_of(final, base) and predictive_loss(base, final) > 0.0


def refitted_path(base: Fit, additions: list[Addition], final: Fit) -> list[Addition]:
    """Additions to a base that follow on one another anew, from where a fit with all of them has their values."""
    path, at = [], base
    for addition in additions:
        effect = final.model.effect(addition.effect)
        at = fitted_near(final, at.model.with_effect(effect) if effect is not None else at.model)
        path.append(replace(addition, fit=at))
    return path


def probability_needed(addition: Addition, fit: Fit, less: Fit, *, dispersion: float | None = None) -> float:
    """Probability, by one-step predictions, that something is missing without it though the load may wander.

    If a factor is given by which the parts of the log disagree about it, its evidence counts as far as they agree.
    """
    own = next((rival for rival in addition.contest if rival.effect.name == addition.effect), None)
    if own is None or fit.model.effect(addition.effect) is None:
        return 1.0
    # An observer that holds a gap also follows a load that wanders: there the two are not to be compared.
    rest = replace(less, held_log_likelihood=None)
    evidence = own.discounted(evidence_of(fit, rest, over=1.0), dispersion) if dispersion is not None else None
    return float(expit(own.visible(fit, rest, evidence)))


def with_lower_probability(addition: Addition, needed: float) -> Addition:
    """The addition with odds in which something is missing with that probability at most."""
    missing = 1.0 - addition.odds.get(NONE, 0.0)
    if needed >= missing:
        return addition
    odds = {name: share * needed / missing for name, share in addition.odds.items() if name != NONE}
    return replace(addition, odds=dict(sorted([*odds.items(), (NONE, 1.0 - needed)], key=lambda item: -item[1])))
