"""Sets with one or two more effects: ranked by their linearised evidence, then fitted, also with slower observers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from diagnosis.evidence.fitted_sets import FittedSets
from diagnosis.evidence.marginal import Explanation
from diagnosis.evidence.proposals import Proposal, proposals_of
from diagnosis.evidence.signatures import Signatures
from diagnosis.levels import DECISIVE
from identification.fit_result import Fit
from identification.predictor import HELD
from identification.threads import in_threads
from plant.effects import Effect

FITTED_SETS = 2
"""Number of sets with one added effect, and with two, that are fitted; and of effects tried in place of one."""
STEP = 4.0
"""Ratio of consecutive observer bandwidths."""
_NOTHING = 1e-3  # gain in log-likelihood that counts as none
_STEPS = 4  # below the bandwidth of the base model alone


@dataclass(frozen=True, eq=False)
class Trial:
    """A set to fit.

    Attributes:
        parent: a fitted set.
        proposal: the effects to add.
        least: gain in log-likelihood from which similar shapes and another observer are also tried.
    """

    parent: Explanation
    proposal: Proposal
    least: float = 0.0

    @property
    def names(self) -> frozenset[str]:
        """The effects of the set."""
        return self.parent.names | self.proposal.names


def proposals(found: FittedSets, parent: Explanation) -> list[Proposal]:
    """Proposals of one or two effects to add to a set."""
    key = parent.names, parent.fit.bandwidth
    if key not in found.proposed:
        kinds = {n: kind for n, kind in found.effects.items() if _would_add(parent.fit, kind)}
        drawn = proposals_of(Signatures.at(parent, kinds, len(found.effects))) if kinds else []
        found.proposed[key] = drawn
    return found.proposed[key]


def extend(
    found: FittedSets,
    parents: Sequence[Explanation],
    bandwidth: float = np.inf,
    *,
    leading_alone: bool = False,
) -> None:
    """Fit the sets with one or two more effects that have the highest linearised evidence, also with another observer.

    Also those with the highest linearised evidence without a discrepancy, for the discrepancy may have absorbed the
    missing effect. A fit of two effects takes longer than one of a single effect, and a chaotic effect takes longest.
    So these are fitted only if their linearised evidence is not far below the best evidence reached so far.
    """
    best = max(parent.log_marginal for parent in parents)
    proposed: dict[frozenset[str], tuple[float, Explanation, Proposal]] = {}
    leading = set[frozenset[str]]()
    for parent in parents:
        for proposal in proposals(found, parent):
            value = parent.log_marginal + proposal.value - best
            if value > proposed.get(proposal.names, (-np.inf,))[0]:
                proposed[proposal.names] = value, parent, proposal
            if proposal.leads:
                leading.add(proposal.names)
    ranked = sorted(proposed.values(), key=lambda each: -each[0])
    promising = [each.names for value, _, each in ranked if value > -DECISIVE]
    likeliest = set[frozenset[str]]()
    if not leading_alone:
        likeliest = {names for size in (1, 2) for names in [n for n in promising if len(n) == size][:FITTED_SETS]}
    wanted = ((value, parent, each) for value, parent, each in ranked if each.names in likeliest | leading)
    chosen = [(value, parent, _with_starts_of(found, parents, each)) for value, parent, each in wanted]
    for costly in (0, 1, 2):
        reached = found.best.log_marginal - best
        now = [Trial(p, e) for v, p, e in chosen if e.costly == costly and (not costly or v > reached - DECISIVE)]
        try_sets(found, now, bandwidth)


def _with_starts_of(found: FittedSets, parents: Sequence[Explanation], proposal: Proposal) -> Proposal:
    """A proposal of one effect, with its starts for all parents.

    If a model lacks a large effect, its motion agrees with the log only with a fast observer.
    """
    if len(proposal.names) > 1 or proposal.chaotic:
        return proposal
    every = (each.starts[0] for parent in parents for each in proposals(found, parent) if each.names == proposal.names)
    return replace(proposal, starts=(tuple(dict.fromkeys((*proposal.starts[0], *chain.from_iterable(every)))),))


def rise(found: FittedSets, parent: Explanation, parents: Sequence[Explanation], bandwidth: float = np.inf) -> None:
    """Fit each effect in addition to a set, from its starts for all parents; try those with the largest gains.

    They are tried with the observer of the set and with another one, as in `extend`.

    The linearised evidence is useless if the model is very poor: its inertia may have absorbed friction, and the
    observer and the discrepancy may have absorbed the missing torque.
    """
    single = [_with_starts_of(found, parents, each) for each in proposals(found, parent) if not each.costly]
    fits = in_threads(lambda each: found.with_one(parent.fit, each), single)
    evidence = {
        each.names: each.evidence(fit.log_likelihood - parent.fit.log_likelihood)
        for each, fit in zip(single, fits, strict=True)
    }
    rising = [each for each in single if evidence[each.names] > 0.0]
    rising.sort(key=lambda each: -evidence[each.names])
    chosen = [
        Trial(parent, each) for each in rising[: 2 * FITTED_SETS]
    ]  # a wider form may rank before the missing effect
    try_sets(found, chosen, bandwidth)


def try_sets(found: FittedSets, trials: Sequence[Trial], bandwidth: float = np.inf) -> None:
    """Fit some sets, also with another observer."""
    new = [each for each in trials if (each.names, each.parent.fit.bandwidth) not in found.fits]
    chosen = list({(each.names, each.parent.fit.bandwidth): each for each in reversed(new)}.values())[::-1]
    for names in dict.fromkeys(each.parent.names for each in chosen):
        names_tried = "; ".join(
            " and ".join(sorted(each.proposal.names)) for each in chosen if each.parent.names == names
        )
        found.tell(f"beside {', '.join(sorted(names)) or 'nothing'}: {names_tried}")
    loose = [each for each in chosen if not each.proposal.chaotic]
    found.add(chain.from_iterable(in_threads(lambda each: list(_tried(found, each, bandwidth)), loose)))
    held: dict[frozenset[str], list[Trial]] = {}
    for each in chosen:
        if each.proposal.chaotic:
            held.setdefault(each.parent.names, []).append(each)
    for beside in held.values():  # each takes as long as all others
        _try_held(found, min(beside, key=lambda each: len(each.proposal.names)))


def _tried(found: FittedSets, trial: Trial, bandwidth: float) -> Iterator[Explanation | None]:
    """One trial, with the observer of its parent and with a slower one; empty if it gains no log-likelihood.

    With a slow observer or none, a fit may end in a local minimum. So if there is no gain, it is repeated with the
    observer of the base model, then with slower ones.
    """
    parent, proposal, least = trial.parent, trial.proposal, trial.least
    fit = found.fitted_with(parent.fit, proposal, parent.fit.bandwidth, parent.fit.log_likelihood + least)
    if fit.log_likelihood <= parent.fit.log_likelihood + _NOTHING:
        if parent.fit.bandwidth < found.null.bandwidth and not found.held:
            begun = found.explanation_of(found.fitted_with(parent.fit, proposal, found.null.bandwidth))
            if begun is not None:
                yield begun
                yield from with_other_observers(found, begun)
        return
    explanation = found.explanation_of(fit)
    yield explanation
    if bandwidth < fit.bandwidth and fit.log_likelihood >= parent.fit.log_likelihood + least:
        yield found.explanation_of(found.fitted(fit, [fit.model], bandwidth))
    if explanation is None and len(proposal.starts) > 1:  # the pair has no evidence: each effect is tried alone
        for starts in proposal.starts:
            yield from _tried(found, replace(trial, proposal=replace(proposal, starts=(starts,))), bandwidth)


def _try_held(found: FittedSets, trial: Trial) -> None:
    """Try a chaotic set, in which small errors grow without bound, with an observer that stabilises the prediction.

    If its evidence there exceeds that of all competing sets, the search continues with this observer for all sets.
    """
    parent = trial.parent.fit
    bandwidth = max(HELD / found.null.log.sample_time, parent.bandwidth)
    fit = _stabilised(found, parent, trial.proposal, bandwidth)
    tried = None if fit is None else found.explanation_of(fit)
    if found.held or tried is None:
        found.add([tried])
        return
    others = _competing(found, bandwidth)
    if all(tried.log_marginal > other.log_marginal for other in others):
        found.held, found.fits = True, {}
        alone = found.explanation_of(found.fitted(found.null, [found.null.model], bandwidth))
        found.add((tried, *others, alone or found.explanation_of(found.null)))


def _stabilised(found: FittedSets, fit: Fit, proposal: Proposal, bandwidth: float) -> Fit | None:
    """The fit of a chaotic set at a bandwidth, from the slowest observer that stabilises the prediction upwards.

    The slower the observer, the wider is the maximum of the likelihood around the true values. None if the set is less
    likely there than the best set.
    """
    slowest = HELD / found.null.log.sample_time
    best = found.fitted(found.best.fit, [found.best.fit.model], slowest).log_likelihood
    risen = found.fitted_with(fit, proposal, slowest, best)
    if risen.log_likelihood < best:
        return None
    while risen.bandwidth < bandwidth:
        risen = found.fitted(risen, [risen.model], min(STEP * risen.bandwidth, bandwidth))
    return risen


def gained_stabilised(found: FittedSets, parent: Explanation, proposal: Proposal) -> float:
    """Gain in log-likelihood by a chaotic set over its parent, with the slowest observer that stabilises both."""
    slowest = HELD / found.null.log.sample_time
    without = found.fitted(parent.fit, [parent.fit.model], slowest)
    return found.fitted_with(parent.fit, proposal, slowest, np.inf).log_likelihood - without.log_likelihood


def _competing(found: FittedSets, bandwidth: float) -> list[Explanation]:
    """The most probable sets, fitted with another observer: the first that has a fit there, and its competitors."""
    others, least = list[Explanation](), -np.inf
    for each in sorted(found.known.values(), key=lambda each: -each.log_marginal):
        if each.log_marginal < least:
            break
        other = found.explanation_of(found.fitted(each.fit, [each.fit.model], bandwidth))
        if other is not None:
            others.append(other)
            least = max(least, each.log_marginal - DECISIVE)
    return others


def _would_add(fit: Fit, kind: type[Effect]) -> bool:
    excluded = any(kind.excludes(type(effect)) for effect in fit.model.effects)
    return fit.log.shows(kind) and not excluded and not fit.model.holds(kind.name)


def with_other_observers(found: FittedSets, best: Explanation) -> Iterator[Explanation]:
    """A set with slower and slower observers, as long as its evidence rises.

    No observer is faster than the base model needs: the innovations would be coloured, and the discrepancy would
    explain the colour. A measured torque has unpredictable noise, for which one bandwidth is best. Then faster
    observers are also tried, as long as the log-likelihood without discrepancy rises at least as much as the evidence,
    and finally steps of half the ratio in both directions.
    """
    measured = best.fit.model.lead() is not None
    fastest = np.inf if measured else found.fastest
    for ratio in (1.0 / STEP, STEP, STEP**-0.5, STEP**0.5) if measured else (1.0 / STEP,):
        while 0.0 < best.fit.bandwidth * ratio <= fastest:
            moved = _behind(found, best, best.fit.bandwidth * ratio)
            if moved is None or (ratio > 1.0 and _gained(best, moved) < moved.log_marginal - best.log_marginal):
                break
            yield moved
            if moved.log_marginal <= best.log_marginal:
                break
            best = moved


def _behind(found: FittedSets, explanation: Explanation, bandwidth: float) -> Explanation | None:
    """The same set with another observer; without one if its bandwidth is not above the lowest allowed."""
    slowest = found.null.bandwidth / STEP**_STEPS
    fit = found.fitted(explanation.fit, [explanation.fit.model], bandwidth if bandwidth > slowest else 0.0)
    return found.explanation_of(fit)


def _gained(before: Explanation, after: Explanation) -> float:
    """Gain in log-likelihood without a discrepancy."""
    return after.fit.log_likelihood - before.fit.log_likelihood
