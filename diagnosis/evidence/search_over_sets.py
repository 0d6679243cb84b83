"""The search over sets of effects: from the best set to those with one or two more, one less or one other.

Each set is fitted exactly and weighed beside the discrepancy. The observer is a part of the noise model: each set is
judged by the bandwidth that suits it best. What needs no observer behind it is predicted without one.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import chain, combinations
from typing import TypeAlias

import numpy as np

from diagnosis.evidence.fitted_sets import Explored
from diagnosis.evidence.larger_sets import (
    ASKED,
    STEP,
    Trial,
    extend,
    proposals,
    rise,
    try_sets,
    with_other_observers,
)
from diagnosis.evidence.marginal import Explanation, families_along
from diagnosis.evidence.posterior import Posterior
from diagnosis.evidence.proposals import Proposal
from diagnosis.evidence.without_name import without_name
from diagnosis.levels import HARDLY_EVER, LIKELY
from identification.errors import Unidentifiable
from identification.fit_result import Fit
from identification.threads import in_threads, without_blas_threads
from plant.effects import Effect
from plant.effects.nonparametric import unnamed

_InPlace: TypeAlias = Callable[[Explored, Explanation, frozenset[str], float | None], list[Proposal]]
_NEAR = 0.3  # of a promise, that it may be too large: linearised, it is rough
_RETUNED = 3  # sets whose observer is chosen anew
_MOST = 5  # times that names are added, and names in a set from which on none is


@without_blas_threads
def explore(null: Fit, effects: Mapping[str, type[Effect]], progress: Callable[[str], None] | None = None) -> Explored:
    """All sets worth a look beyond a fitted base model."""
    tell = progress or (lambda line: None)
    families = families_along(null)
    if families is None:
        raise Unidentifiable("The motion of the base model grows without bound.")
    found = Explored(null=null, effects=effects, tell=tell, families=families)
    grid = sorted({0.0, null.bandwidth / STEP**2} - {null.bandwidth})
    found.add([found.weighed(null)])
    found.add(in_threads(lambda bandwidth: found.weighed(found.fitted(null, [null.model], bandwidth)), grid))
    if not found.fits:
        raise Unidentifiable("The motion of the base model grows without bound.")
    bare = list(found.fits.values())
    rise(found, found.fits.get((frozenset(), null.bandwidth), found.best), bare)
    extend(found, bare)
    _improve(found)
    _replace(found)
    _replace_without_name(found)
    _fit_leading(found)
    return found


def _fit_leading(found: Explored) -> None:
    """Fit the set of all names that are likelier there than not, if it was not yet: it will be the model."""
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
        found.add([found.weighed(found.fitted(holder.fit, [model], holder.fit.bandwidth))])


def _improve(found: Explored) -> None:
    """Add names to the best set, and take such away, while that makes a better one.

    Where what came last is smaller than the discrepancy, so would be what comes next, unless that is in it: then only
    those are asked that would promise most without one.
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


def _parents(found: Explored, best: Explanation) -> list[Explanation]:
    """What is asked for more: the best set, and where it lacks something the one that leaves least behind an observer.

    That of the base model, behind which also a poor model follows the log.
    """
    observed = [each for (_, bandwidth), each in found.fits.items() if bandwidth == found.null.bandwidth]
    if not observed or best.discrepancy.posterior.material <= LIKELY:
        return [best]
    barest = max(observed, key=lambda each: each.fit.log_likelihood)
    return [best] if barest is best else [best, barest]


def _are_small(explanation: Explanation, names: Collection[str]) -> bool:
    sizes = explanation.sizes
    return bool(names) and all(sizes.effects[name] < sizes.to_exceed(name) for name in names)


def _retune(found: Explored) -> None:
    """Lower the bandwidth of the best sets to where they are likeliest: what is named or smooth is no observer's work.

    Also of the set that leaves least without a discrepancy: behind a fast observer that one may explain as much as a
    name. It never rises: behind an observer that is faster than the log asks for, innovations have a colour, which
    anything that carries the measurement's noise would explain.
    """

    def lowered(best: Explanation) -> list[Explanation]:
        return list(with_other_observers(found, best))

    if not found.held:
        ranked = sorted(found.known.values(), key=lambda each: -each.log_marginal)
        barest = max(ranked, key=lambda each: each.fit.log_likelihood)
        leading = ranked[:_RETUNED] if barest in ranked[:_RETUNED] else [*ranked[:_RETUNED], barest]
        found.add(chain.from_iterable(in_threads(lowered, leading)))


def _replace(found: Explored) -> None:
    """Ask for every name that is not minor, and two that one effect is confounded with, what may stand there."""
    before = -np.inf
    while (best := found.best).names and best.log_marginal > before + HARDLY_EVER:
        before = best.log_marginal
        _try_in_places(found, best, _places(found, best), _in_place)
        for narrow in _narrowed(found, best):
            extend(found, [narrow], best.fit.bandwidth)
        if found.best is not best:
            _improve(found)


def _replace_without_name(found: Explored) -> None:
    """Ask there what has no name: else a name that only looks like the cause would be sure.

    Beside that names may be left out, but none is added: each would have to exceed it. Where nothing would be named,
    what has no name is asked by itself.
    """
    before = -np.inf
    while (best := found.best).log_marginal > before + HARDLY_EVER:
        before = best.log_marginal
        alone = len(best.names) < _MOST and _names_nothing(found)
        _try_in_places(found, best, [*_places(found, best), *([frozenset[str]()] if alone else [])], _without_name)
        if found.best is not best:
            _retune(found)
            _without_each(found, found.best)


def _names_nothing(found: Explored) -> bool:
    """Whether no effect of the machine is likelier there than not."""
    posterior = Posterior.over(found.known.values())
    measured = {name for name, kind in found.effects.items() if kind.measured}
    return not any(posterior.probability(name) > LIKELY for name in posterior.names().keys() - measured)


def _try_in_places(found: Explored, best: Explanation, places: Sequence[frozenset[str]], in_place: _InPlace) -> None:
    """Fit what may stand in the places of names of a set."""

    def asked(out: frozenset[str]) -> list[Trial]:
        less = _less(found, best, out) if out else best
        if less is None:
            return []
        least = _roughly_promised(found, less, out) if out else 0.0
        return [Trial(less, each, max(least or 0.0, 0.0)) for each in in_place(found, less, out, least)]

    try_sets(found, list(chain.from_iterable(in_threads(asked, places))), best.fit.bandwidth)


def _places(found: Explored, best: Explanation) -> list[frozenset[str]]:
    """Names that are not minor, and two of them that one effect is confounded with."""
    named = sorted(best.names.difference(unnamed))
    large = [name for name in named if best.sizes.effects[name] >= best.sizes.to_exceed(name)]
    two = (
        {one, other}
        for one, other in combinations(large, 2)
        if _confounded(found.effects, one) & _confounded(found.effects, other)
    )
    return [frozenset(out) for out in (*({name} for name in large), *two)]


def _narrowed(found: Explored, best: Explanation) -> list[Explanation]:
    """The sets with the special case of an effect in its place."""
    tried = [found.weighed(fit) for name in sorted(best.names) for fit in found.narrowed(best.fit, name)]
    found.add(tried)
    return [found.known[each.names] for each in tried if each is not None]


def _roughly_promised(found: Explored, less: Explanation, out: frozenset[str]) -> float | None:
    """The least that names which were taken out of a set may be worth there: linearised, a promise is rough."""
    promised = [each.value for each in proposals(found, less) if each.names == out]
    return max(promised) - max(HARDLY_EVER, _NEAR * max(promised)) if promised else None


def _in_place(found: Explored, less: Explanation, out: frozenset[str], least: float | None) -> list[Proposal]:
    """What promises at least so much beside a set that names were taken out of, and wider forms of them.

    Of a chaotic effect a promise says little, so it is asked for where it is confounded with such a name.
    """
    others = [each for each in proposals(found, less) if len(each.names) == 1 and not each.names & out]
    ranked = sorted(others, key=lambda each: -each.value)
    near = [each for each in ranked if least is not None and each.value >= least][:ASKED]
    alike = frozenset[str]().union(*(_confounded(found.effects, name) for name in out))
    for each in others:
        effect = each.starts[0][0]
        if each not in near and (out & set(effect.contains) or effect.name in alike):
            near.append(each)
    return near


def _without_name(found: Explored, less: Explanation, out: frozenset[str], least: float | None) -> list[Proposal]:
    """What has no name and promises at least as much as the names that were taken out of a set."""
    return [each for each in without_name(less) if least is not None and each.value >= least][:ASKED]


def _confounded(effects: Mapping[str, type[Effect]], name: str) -> frozenset[str]:
    """Effects that say of themselves that they look like one, or that it says so of."""
    own = effects[name].confused_with if name in effects else ()
    return frozenset(other for other, kind in effects.items() if other in own or name in kind.confused_with)


def _less(found: Explored, best: Explanation, out: frozenset[str]) -> Explanation | None:
    """The set without some names, behind the same observer or behind that of the base model, whichever suits it.

    From the latter it goes on behind slower ones: straight there a fit may end astray.
    """
    names, model = best.names - out, best.fit.model
    for name in out:
        model = model.without_effect(name)
    observers = {best.fit.bandwidth} if found.held else {best.fit.bandwidth, found.null.bandwidth}
    for bandwidth in sorted(observers):
        if (names, bandwidth) not in found.fits:
            found.add([found.weighed(found.fitted(best.fit, [model], bandwidth))])
    known = [found.fits[names, each] for each in observers if (names, each) in found.fits]
    best_one = max(known, key=lambda each: each.log_marginal, default=None)
    if best_one is not None and best_one.fit.bandwidth > best.fit.bandwidth and not found.held:
        found.add(with_other_observers(found, best_one))
    return None if best_one is None else found.known[names]


def _without_each(found: Explored, best: Explanation) -> None:
    """The sets with one name less."""
    in_threads(lambda name: _less(found, best, frozenset({name})), sorted(best.names))
