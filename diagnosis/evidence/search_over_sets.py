"""The search over sets of effects: from the best set to those with one or two more, one less or one exchanged.

Each set is fitted exactly, and its evidence is calculated with the discrepancy. The observer is a part of the noise
model: each set has the bandwidth with its highest evidence, zero (no observer) included.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import chain, combinations
from typing import TypeAlias

import numpy as np

from diagnosis.evidence.fitted_sets import FittedSets
from diagnosis.evidence.larger_sets import (
    FITTED_SETS,
    STEP,
    Trial,
    extend,
    gained_stabilised,
    proposals,
    rise,
    try_sets,
    with_other_observers,
)
from diagnosis.evidence.marginal import Explanation, families_along
from diagnosis.evidence.nonparametric_proposals import nonparametric_proposals
from diagnosis.evidence.posterior import Posterior
from diagnosis.evidence.proposals import Proposal
from diagnosis.levels import DECISIVE, LIKELY
from identification.errors import Unidentifiable
from identification.fit_result import Fit
from identification.threads import in_threads, without_blas_threads
from plant.effects import Effect
from plant.effects.nonparametric import unnamed

_InPlace: TypeAlias = Callable[[FittedSets, Explanation, frozenset[str], float | None], list[Proposal]]
_RETUNED = 3  # sets whose observer bandwidth is optimised again
_MOST = 5  # rounds of adding effects, and number of effects in a set from which none is added


@without_blas_threads
def explore(
    null: Fit,
    effects: Mapping[str, type[Effect]],
    progress: Callable[[str], None] | None = None,
    doubtful: Fit | None = None,
) -> FittedSets:
    """Search the sets of effects beyond a fitted base model.

    Args:
        null: fit of the base model.
        effects: candidates.
        progress: called with a line of text at each stage.
        doubtful: the most likely fit of the base model if that is of no use; then `null` has a slower observer.
    """
    tell = progress or (lambda line: None)
    families = families_along(null)
    if families is None:
        raise Unidentifiable("The motion of the base model grows without bound.")
    found = FittedSets(null=null, effects=effects, tell=tell, families=families, doubtful=doubtful)
    grid = sorted({0.0, null.bandwidth / STEP**2, found.fastest} - {null.bandwidth})
    found.add([found.explanation_of(null)])
    found.add(in_threads(lambda bandwidth: found.explanation_of(found.fitted(null, [null.model], bandwidth)), grid))
    if not found.fits:
        raise Unidentifiable("The motion of the base model grows without bound.")
    bare = list(found.fits.values())
    suits = found.best.fit.bandwidth  # with the discrepancy, the base model may need another observer than alone
    rise(found, found.fits.get((frozenset(), null.bandwidth), found.best), bare, suits)
    extend(found, bare, suits)
    _improve(found)
    _weigh_alone(found)
    _try_chaotic(found)
    _replace(found)
    _replace_by_nonparametric(found)
    _fit_leading(found)
    return found


def explore_from(found: FittedSets, fit: Fit) -> bool:
    """Continue a search from a fit of one of its sets, if that is better than all of its own; whether it is.

    The search starts its fits from one another. If one has stopped too early, those of the competing sets have too. So
    all are discarded and fitted again, from the better fit.
    """
    names = frozenset(effect.name for effect in fit.model.effects) - {each.name for each in found.null.model.effects}
    own = found.fits.get((names, fit.bandwidth))  # None if that observer was not asked for this set
    if own is None or fit.log_likelihood <= own.fit.log_likelihood + DECISIVE:
        return False
    better = found.explanation_of(fit)
    if better is None or better.log_marginal <= found.best.log_marginal + DECISIVE:
        return False
    found.fits.clear()
    found.proposed.clear()
    found.add([better, found.explanation_of(found.null)])
    _improve(found)
    _replace(found)
    _replace_by_nonparametric(found)
    _fit_leading(found)
    return True


def _weigh_alone(found: FittedSets) -> None:
    """Weigh every effect fitted alone, if something is left unexplained; if one is better than all sets, go on from it.

    They were chosen by their likelihood. But if the model is poor, an effect may raise it less than others do, and
    explain more beside an unmodelled torque.
    """
    best, bare = found.best, found.fits.get((frozenset(), found.null.bandwidth))
    if bare is None or found.held or best.discrepancy.posterior.material <= LIKELY:
        return
    alone = [each for each in proposals(found, bare) if not each.costly]
    found.add(in_threads(lambda each: found.explanation_of(found.with_one(bare.fit, each)), alone))
    if found.best is not best:
        _improve(found)


def _try_chaotic(found: FittedSets) -> None:
    """Try chaotic effects alone and, if that gains something, beside the best set; unless that leaves nothing over.

    The linearised evidence of a chaotic effect says little, and other effects that resemble it explain a part of it.
    """
    bare, best = found.known[frozenset()], found.best
    if found.held or best.discrepancy.posterior.material <= LIKELY:
        return
    for each in [each for each in proposals(found, bare) if each.chaotic and len(each.names) == 1]:
        try_sets(found, [Trial(bare, each)])
        if found.best is best and best is not bare and gained_stabilised(found, bare, each) > DECISIVE:
            try_sets(found, [Trial(best, other) for other in proposals(found, best) if other.names == each.names])
    if found.best is not best:
        _improve(found)


def _fit_leading(found: FittedSets) -> None:
    """Fit the leading set of the posterior if it has not been fitted: it becomes the model."""
    tried = set[frozenset[str]]()
    while True:
        posterior = Posterior.over(found.known.values())
        names = posterior.leading
        holder = next((each for each in posterior.sets if names <= each.may_be), None)
        if names in found.known or names in tried or holder is None:
            return
        tried.add(names)
        model = holder.fit.model
        for name in sorted(holder.names - names):
            special, _ = holder.sizes.beyond_special.get(name, (None, 0.0))
            effect, model = model.effect(name), model.without_effect(name)
            if effect is not None and special in names:
                model = model.with_effect(effect.reduced()[0])
        found.add([found.explanation_of(found.fitted(holder.fit, [model], holder.fit.bandwidth))])


def _improve(found: FittedSets) -> None:
    """Add effects to the best set, and remove effects from it, as long as the evidence rises.

    If the last added effects are smaller than the discrepancy, further ones would be too, unless the discrepancy has
    absorbed them. Then only the sets with the highest linearised evidence without discrepancy are tried.
    """
    before: Explanation | None = None
    for _ in range(_MOST):
        _retune(found)
        _without_each(found, found.best)
        if (best := found.best) is before or len(best.names) >= _MOST:
            break
        small = before is not None and _are_small(best, best.names - before.names)
        extend(found, _parents(found, best), leading_alone=small)
        before = best


def _parents(found: FittedSets, best: Explanation) -> list[Explanation]:
    """The sets to extend: the best one and, if its unmodelled torque is probably not zero, a second one.

    That is the set with the highest log-likelihood with the observer of the base model: with it, a poor model also
    follows the log.
    """
    observed = [each for (_, bandwidth), each in found.fits.items() if bandwidth == found.null.bandwidth]
    if not observed or best.discrepancy.posterior.material <= LIKELY:
        return [best]
    simplest = max(observed, key=lambda each: each.fit.log_likelihood)
    return [best] if simplest is best else [best, simplest]


def _are_small(explanation: Explanation, names: Collection[str]) -> bool:
    sizes = explanation.sizes
    return bool(names) and all(sizes.effects[name] < sizes.to_exceed(name) for name in names)


def _retune(found: FittedSets) -> None:
    """Lower the observer bandwidth of the best sets as long as their evidence rises.

    Also of the set with the highest log-likelihood without discrepancy: with a fast observer a discrepancy may explain
    as much as an effect. Only with a measured torque the bandwidth may also rise: with an observer that is faster than
    necessary the innovations are coloured, and every signal with the noise of the measurement would explain them.
    """

    def lowered(best: Explanation) -> list[Explanation]:
        return list(with_other_observers(found, best))

    if not found.held:
        ranked = sorted(found.known.values(), key=lambda each: -each.log_marginal)
        simplest = max(ranked, key=lambda each: each.fit.log_likelihood)
        leading = ranked[:_RETUNED] if simplest in ranked[:_RETUNED] else [*ranked[:_RETUNED], simplest]
        found.add(chain.from_iterable(in_threads(lowered, leading)))


def _replace(found: FittedSets) -> None:
    """Try other effects in place of each effect that is not minor, and of pairs with a common confounded effect."""
    before = -np.inf
    while (best := found.best).names and best.log_marginal > before + DECISIVE:
        before = best.log_marginal
        _try_in_places(found, best, _places(found, best), _in_place)
        for narrow in _narrowed(found, best):
            extend(found, [narrow], best.fit.bandwidth)
        if found.best is not best:
            _improve(found)


def _replace_by_nonparametric(found: FittedSets) -> None:
    """Try non-parametric effects in place of effects: otherwise an effect that resembles the cause seems certain.

    After such a replacement effects may be removed, but none is added: each would have to exceed the non-parametric
    effect. If no effect would be reported, non-parametric effects are also added to the best set.
    """
    before = -np.inf
    while (best := found.best).log_marginal > before + DECISIVE:
        before = best.log_marginal
        alone = len(best.names) < _MOST and _names_nothing(found)
        _try_in_places(found, best, [*_places(found, best), *([frozenset[str]()] if alone else [])], _nonparametric)
        if found.best is not best:
            _retune(found)
            _without_each(found, found.best)


def _names_nothing(found: FittedSets) -> bool:
    """Whether no effect of the machine has a probability above 0.5; a lag of the torque measurement does not count."""
    posterior = Posterior.over(found.known.values())
    measured = {name for name, kind in found.effects.items() if kind.measured}
    return not any(posterior.probability(name) > LIKELY for name in posterior.names().keys() - measured)


def _try_in_places(found: FittedSets, best: Explanation, places: Sequence[frozenset[str]], in_place: _InPlace) -> None:
    """Fit the sets with other effects in place of some effects of a set."""

    def trials(out: frozenset[str]) -> list[Trial]:
        less = _less(found, best, out) if out else best
        if less is None:
            return []
        least = _roughly_promised(found, less, out) if out else 0.0
        return [Trial(less, each, max(least or 0.0, 0.0)) for each in in_place(found, less, out, least)]

    try_sets(found, list(chain.from_iterable(in_threads(trials, places))), best.fit.bandwidth)


def _places(found: FittedSets, best: Explanation) -> list[frozenset[str]]:
    """Effects that are not minor, and pairs of them that are confounded with the same effect."""
    named = sorted(best.names.difference(unnamed))
    large = [name for name in named if best.sizes.effects[name] >= best.sizes.to_exceed(name)]
    two = (
        {one, other}
        for one, other in combinations(large, 2)
        if _confounded(found.effects, one) & _confounded(found.effects, other)
    )
    return [frozenset(out) for out in (*({name} for name in large), *two)]


def _narrowed(found: FittedSets, best: Explanation) -> list[Explanation]:
    """The sets with the special case of an effect in its place."""
    tried = [found.explanation_of(fit) for name in sorted(best.names) for fit in found.narrowed(best.fit, name)]
    found.add(tried)
    return [found.known[each.names] for each in tried if each is not None]


def _roughly_promised(found: FittedSets, less: Explanation, out: frozenset[str]) -> float | None:
    """Lower limit of the linearised evidence of effects removed from a set; None without a proposal.

    The margin is half of it, as it may be that much too large.
    """
    promised = [each.value for each in proposals(found, less) if each.names == out]
    return max(promised) - max(DECISIVE, (1.0 - LIKELY) * max(promised)) if promised else None


def _in_place(found: FittedSets, less: Explanation, out: frozenset[str], least: float | None) -> list[Proposal]:
    """Single effects to add in place of removed ones: those with at least the linearised evidence `least`.

    Also wider forms of the removed effects, and all effects confounded with them: the linearised evidence of a chaotic
    effect says little.
    """
    others = [each for each in proposals(found, less) if len(each.names) == 1 and not each.names & out]
    ranked = sorted(others, key=lambda each: -each.value)
    near = [each for each in ranked if least is not None and each.value >= least][:FITTED_SETS]
    confounded = frozenset[str]().union(*(_confounded(found.effects, name) for name in out))
    for each in others:
        effect = each.starts[0][0]
        if each not in near and (out & set(effect.contains) or effect.name in confounded):
            near.append(each)
    return near


def _nonparametric(found: FittedSets, less: Explanation, out: frozenset[str], least: float | None) -> list[Proposal]:
    """Non-parametric effects with at least the linearised evidence `least`."""
    return [each for each in nonparametric_proposals(less) if least is not None and each.value >= least][:FITTED_SETS]


def _confounded(effects: Mapping[str, type[Effect]], name: str) -> frozenset[str]:
    """Effects that are declared as confounded with an effect, on either side."""
    own = effects[name].confused_with if name in effects else ()
    return frozenset(other for other, kind in effects.items() if other in own or name in kind.confused_with)


def _less(found: FittedSets, best: Explanation, out: frozenset[str]) -> Explanation | None:
    """The set without some effects, with the same observer or that of the base model, whichever has more evidence.

    From the latter, slower observers are tried step by step: with a slow one at once, a fit may end in a local minimum.
    """
    names, model = best.names - out, best.fit.model
    for name in out:
        model = model.without_effect(name)
    observers = {best.fit.bandwidth} if found.held else {best.fit.bandwidth, found.null.bandwidth}
    for bandwidth in sorted(observers):
        if (names, bandwidth) not in found.fits:
            found.add([found.explanation_of(found.fitted(best.fit, [model], bandwidth))])
    known = [found.fits[names, each] for each in observers if (names, each) in found.fits]
    best_one = max(known, key=lambda each: each.log_marginal, default=None)
    if best_one is not None and best_one.fit.bandwidth > best.fit.bandwidth and not found.held:
        found.add(with_other_observers(found, best_one))
    return None if best_one is None else found.known[names]


def _without_each(found: FittedSets, best: Explanation) -> None:
    """Fit the sets with one effect less."""
    in_threads(lambda name: _less(found, best, frozenset({name})), sorted(best.names))
