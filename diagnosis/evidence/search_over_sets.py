"""The search over sets of effects: from the best set to those with one or two more, one less or one other.

Each set is fitted exactly and weighed beside the discrepancy. The observer is a part of the noise model: each set is
judged by the bandwidth that suits it best. What needs no observer behind it is predicted without one.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, combinations

import numpy as np

from diagnosis.evidence.fitted_sets import Explored
from diagnosis.evidence.marginal import Explanation, families_along
from diagnosis.evidence.posterior import Posterior
from diagnosis.evidence.signatures import Proposal, Signatures
from identification.errors import Unidentifiable
from identification.fit_result import Fit
from identification.predictor import HELD
from identification.threads import in_threads, without_blas_threads
from plant.effects import Effect

_ASKED = 2  # sets with one name more, and with two, that are tried beside a set; and names in the place of one
_BELOW = 5.0  # that a set may promise below the one at hand: linearised, a promise is rough
_NEAR = 0.3  # ... by a share of it
_NOTHING = 1e-3  # rise of the log-likelihood that says nothing
_RETUNED = 3  # sets whose observer is chosen anew
_MOST = 5  # times that names are added
_STEP, _STEPS = 4.0, 4  # from bandwidth to bandwidth, and how many below that of the base model alone


@without_blas_threads
def explore(null: Fit, effects: Mapping[str, type[Effect]], progress: Callable[[str], None] | None = None) -> Explored:
    """All sets worth a look beyond a fitted base model."""
    tell = progress or (lambda line: None)
    families = families_along(null)
    if families is None:
        raise Unidentifiable("The motion of the base model grows without bound.")
    found = Explored(null=null, effects=effects, tell=tell, families=families)
    grid = sorted({0.0, null.bandwidth / _STEP**2} - {null.bandwidth})
    found.add([found.weighed(null)])
    found.add(in_threads(lambda bandwidth: found.weighed(found.fitted(null, [null.model], bandwidth)), grid))
    if not found.fits:
        raise Unidentifiable("The motion of the base model grows without bound.")
    _extend(found, list(found.fits.values()), also=_rising(found, found.best))
    _improve(found)
    _replace(found)
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
            special, _ = holder.sizes.beyond_special.get(name, ("", 0.0))
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
        if (best := found.best) is before:
            break
        small = before is not None and _are_small(best, best.names - before.names)
        _extend(found, [best], leading_alone=small)
        before = best


def _are_small(explanation: Explanation, names: Collection[str]) -> bool:
    sizes = explanation.sizes
    return bool(names) and all(sizes.effects[name] < sizes.discrepancy for name in names)


def _retune(found: Explored) -> None:
    """Lower the bandwidth of the best sets to where they are likeliest: what is named or smooth is no observer's work.

    Also of the set that leaves least without a discrepancy: behind a fast observer that one may explain as much as a
    name. It never rises: behind an observer that is faster than the log asks for, innovations have a colour, which
    anything that carries the measurement's noise would explain.
    """

    def lowered(best: Explanation) -> list[Explanation]:
        return list(_with_slower_observers(found, best))

    if not found.held:
        ranked = sorted(found.known.values(), key=lambda each: -each.log_marginal)
        barest = max(ranked, key=lambda each: each.fit.log_likelihood)
        leading = ranked[:_RETUNED] if barest in ranked[:_RETUNED] else [*ranked[:_RETUNED], barest]
        found.add(chain.from_iterable(in_threads(lowered, leading)))


def _with_slower_observers(found: Explored, best: Explanation) -> Iterator[Explanation]:
    """A set behind slower and slower observers, as long as it gets likelier; the one before the last is best."""
    slowest = found.null.bandwidth / _STEP**_STEPS
    while best.fit.bandwidth:
        bandwidth = best.fit.bandwidth / _STEP
        moved = found.weighed(found.fitted(best.fit, [best.fit.model], bandwidth if bandwidth > slowest else 0.0))
        if moved is None:
            return
        yield moved
        if moved.log_marginal <= best.log_marginal:
            return
        best = moved


def _replace(found: Explored) -> None:
    """Ask for every name that is not minor, and two that one effect is confounded with, what may stand there."""
    before = -np.inf
    while (best := found.best).names and best.log_marginal > before + _BELOW:
        before = best.log_marginal
        large = [name for name in sorted(best.names) if best.sizes.effects[name] >= best.sizes.discrepancy]
        places = [{name} for name in large]
        for one, other in combinations(large, 2):
            if _confounded(found.effects, one) & _confounded(found.effects, other):
                places.append({one, other})
        for out in map(frozenset, places):
            if (less := _less(found, best, out)) is not None:
                least = _roughly_promised(found, less, out)
                _try(found, _in_place(found, less, out, least), best.fit.bandwidth, max(least or 0.0, 0.0))
        for narrow in _narrowed(found, best):
            _extend(found, [narrow], best.fit.bandwidth)
        if found.best is not best:
            _improve(found)


def _narrowed(found: Explored, best: Explanation) -> list[Explanation]:
    """The sets with the special case of an effect in its place."""
    tried = [found.weighed(fit) for name in sorted(best.names) for fit in found.narrowed(best.fit, name)]
    found.add(tried)
    return [found.known[each.names] for each in tried if each is not None]


def _roughly_promised(found: Explored, less: Explanation, out: frozenset[str]) -> float | None:
    """The least that names which were taken out of a set may be worth there: linearised, a promise is rough."""
    promised = [each.value for each in _proposals(found, less) if each.names == out]
    return max(promised) - max(_BELOW, _NEAR * max(promised)) if promised else None


def _in_place(
    found: Explored, less: Explanation, out: frozenset[str], least: float | None
) -> list[tuple[Explanation, Proposal]]:
    """What promises at least so much beside a set that names were taken out of, and wider forms of them.

    Of a chaotic effect a promise says little, so it is asked for where it is confounded with such a name.
    """
    others = [each for each in _proposals(found, less) if len(each.names) == 1 and not each.names & out]
    ranked = sorted(others, key=lambda each: -each.value)
    near = [each for each in ranked if least is not None and each.value >= least][:_ASKED]
    alike = frozenset[str]().union(*(_confounded(found.effects, name) for name in out))
    for each in others:
        effect = each.starts[0][0]
        if each not in near and (out & set(effect.contains) or effect.name in alike):
            near.append(each)
    return [(less, each) for each in near]


def _confounded(effects: Mapping[str, type[Effect]], name: str) -> frozenset[str]:
    """Effects that say of themselves that they look like one, or that it says so of."""
    own = effects[name].confused_with
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
        found.add(_with_slower_observers(found, best_one))
    return None if best_one is None else found.known[names]


def _without_each(found: Explored, best: Explanation) -> None:
    """The sets with one name less."""
    in_threads(lambda name: _less(found, best, frozenset({name})), sorted(best.names))


def _proposals(found: Explored, parent: Explanation) -> list[Proposal]:
    key = parent.names, parent.fit.bandwidth
    if key not in found.proposed:
        asked = {n: kind for n, kind in found.effects.items() if _would_add(parent.fit, kind)}
        drawn = Signatures.at(parent, asked, len(found.effects)).proposals() if asked else []
        found.proposed[key] = drawn
    return found.proposed[key]


def _extend(
    found: Explored,
    parents: Sequence[Explanation],
    bandwidth: float = np.inf,
    *,
    leading_alone: bool = False,
    also: Collection[frozenset[str]] = (),
) -> None:
    """Fit the sets with one or two names more that promise most, and `also` others; also behind another observer.

    And those that would promise most if there were no discrepancy: one that has taken much over leaves little to see.
    Two take longer than one, and what is chaotic longer than all others: they are fitted where they promise more than
    those before have come by.
    """
    best = max(parent.log_marginal for parent in parents)
    proposed: dict[frozenset[str], tuple[float, Explanation, Proposal]] = {}
    leading = set(also)
    for parent in parents:
        for proposal in _proposals(found, parent):
            value = parent.log_marginal + proposal.value - best
            if value > proposed.get(proposal.names, (-np.inf,))[0]:
                proposed[proposal.names] = value, parent, proposal
            if proposal.leads:
                leading.add(proposal.names)
    ranked = sorted(proposed.values(), key=lambda each: -each[0])
    promising = [each.names for value, _, each in ranked if value > -_BELOW]
    likeliest = set[frozenset[str]]()
    if not leading_alone:
        likeliest = {names for size in (1, 2) for names in [n for n in promising if len(n) == size][:_ASKED]}
    chosen = [(value, parent, each) for value, parent, each in ranked if each.names in likeliest | leading]
    for costly in (0, 1, 2):
        reached = found.best.log_marginal - best
        now = [(p, e) for v, p, e in chosen if e.costly == costly and (not costly or v > reached - _BELOW)]
        _try(found, now, bandwidth)


def _rising(found: Explored, parent: Explanation) -> list[frozenset[str]]:
    """The names that are worth most beside a set by a few iterations of a fit.

    A promise is linear. It is worth nothing where the model is so poor that its inertia is that of friction, or that
    its observer and the discrepancy have taken the missing torque over.
    """
    asked = [each for each in _proposals(found, parent) if not each.costly]
    gains = in_threads(lambda each: found.gained(parent.fit, each), asked)
    worth = {each.names: each.worth(gain) for each, gain in zip(asked, gains, strict=True)}
    return sorted((names for names, value in worth.items() if value > 0.0), key=lambda names: -worth[names])[:_ASKED]


def _try(
    found: Explored,
    pairs: Sequence[tuple[Explanation, Proposal]],
    bandwidth: float = np.inf,
    least: float = 0.0,
) -> None:
    """Fit some sets, each of them one that is there and what is proposed beside it; also behind another observer.

    What brings less than the least log-likelihood is not followed further.
    """
    chosen = [(p, each) for p, each in pairs if (p.names | each.names, p.fit.bandwidth) not in found.fits]
    for names in dict.fromkeys(parent.names for parent, _ in chosen):
        told = "; ".join(" and ".join(sorted(each.names)) for p, each in chosen if p.names == names)
        found.tell(f"beside {', '.join(sorted(names)) or 'nothing'}: {told}")
    held = [(p, each) for p, each in chosen if each.chaotic]
    loose = [pair for pair in chosen if pair not in held]
    found.add(chain.from_iterable(in_threads(lambda pair: list(_tried(found, *pair, bandwidth, least)), loose)))
    if held:
        _try_held(found, held[:1])  # each takes as long as all others


def _tried(
    found: Explored, parent: Explanation, proposal: Proposal, bandwidth: float, least: float
) -> Iterator[Explanation | None]:
    """One of them, behind the observer of what is there and a slower one; nothing where it says no more than that.

    Without an observer a fit may end astray; so where it is no better there, it begins behind that of the base model.
    """
    fit = found.fitted_with(parent.fit, proposal, parent.fit.bandwidth, least)
    if fit.log_likelihood <= parent.fit.log_likelihood + _NOTHING:
        if parent.fit.bandwidth < found.null.bandwidth and not found.held:
            begun = found.weighed(found.fitted_with(parent.fit, proposal, found.null.bandwidth))
            if begun is not None:
                yield begun
                yield from _with_slower_observers(found, begun)
        return
    weighed = found.weighed(fit)
    yield weighed
    if bandwidth < fit.bandwidth and fit.log_likelihood >= parent.fit.log_likelihood + least:
        yield found.weighed(found.fitted(fit, [fit.model], bandwidth))
    if weighed is None and len(proposal.starts) > 1:  # where two do not get on, each is asked alone
        for starts in proposal.starts:
            yield from _tried(found, parent, replace(proposal, starts=(starts,)), bandwidth, least)


def _try_held(found: Explored, chosen: Sequence[tuple[Explanation, Proposal]]) -> None:
    """Sets in which small errors grow without bound: they are weighed behind an observer that holds them.

    Where such a set is likelier there than the best of the others, all go on behind that observer.
    """
    bandwidth = max(HELD / found.null.log.sample_time, *(parent.fit.bandwidth for parent, _ in chosen))
    tried = in_threads(lambda pair: found.weighed(found.fitted_with(pair[0].fit, pair[1], bandwidth)), chosen)
    loose = max((each for each in tried if each is not None), key=lambda each: each.log_marginal, default=None)
    if found.held or loose is None:
        found.add(tried)
        return
    best = found.best
    rival = found.weighed(found.fitted(best.fit, [best.fit.model], loose.fit.bandwidth))
    if rival is None or loose.log_marginal > rival.log_marginal:
        found.held, found.fits = True, {}
        alone = found.weighed(found.fitted(found.null, [found.null.model], loose.fit.bandwidth))
        found.add((*tried, rival, alone or found.weighed(found.null)))


def _would_add(fit: Fit, kind: type[Effect]) -> bool:
    drivetrain = fit.model.drivetrain
    return not fit.model.holds(kind.name) and fit.log.shows(kind) and not (kind.flexible and drivetrain is not None)
