"""Sets with one or two more effects: ranked by their linearised evidence, then fitted, also with slower observers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from diagnosis.evidence.fitted_sets import Explored
from diagnosis.evidence.marginal import Explanation
from diagnosis.evidence.proposals import Proposal, proposals_of
from diagnosis.evidence.signatures import Signatures
from diagnosis.levels import HARDLY_EVER
from identification.fit_result import Fit
from identification.predictor import HELD
from identification.threads import in_threads
from plant.effects import Effect

ASKED = 2
"""Sets with one name more, and with two, that are tried beside a set; and names in the place of one."""
STEP = 4.0
"""From bandwidth to bandwidth."""
_NOTHING = 1e-3  # rise of the log-likelihood that says nothing
_STEPS = 4  # below the bandwidth of the base model alone


@dataclass(frozen=True, eq=False)
class Trial:
    """A set to fit.

    Attributes:
        parent: a set that is there.
        proposal: what is added to it.
        least: log-likelihood that it has to bring to be followed further.
    """

    parent: Explanation
    proposal: Proposal
    least: float = 0.0

    @property
    def names(self) -> frozenset[str]:
        """Of the set."""
        return self.parent.names | self.proposal.names


def proposals(found: Explored, parent: Explanation) -> list[Proposal]:
    """The sets of one or two effects that promise anything beside a set."""
    key = parent.names, parent.fit.bandwidth
    if key not in found.proposed:
        asked = {n: kind for n, kind in found.effects.items() if _would_add(parent.fit, kind)}
        drawn = proposals_of(Signatures.at(parent, asked, len(found.effects))) if asked else []
        found.proposed[key] = drawn
    return found.proposed[key]


def extend(
    found: Explored,
    parents: Sequence[Explanation],
    bandwidth: float = np.inf,
    *,
    leading_alone: bool = False,
) -> None:
    """Fit the sets with one or two names more that promise most, also behind another observer.

    And those that would promise most if there were no discrepancy: one that has taken much over leaves little to see.
    Two take longer than one, and what is chaotic longer than all others: they are fitted where they promise more than
    those before have come by.
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
    promising = [each.names for value, _, each in ranked if value > -HARDLY_EVER]
    likeliest = set[frozenset[str]]()
    if not leading_alone:
        likeliest = {names for size in (1, 2) for names in [n for n in promising if len(n) == size][:ASKED]}
    wanted = ((value, parent, each) for value, parent, each in ranked if each.names in likeliest | leading)
    chosen = [(value, parent, _with_starts_of(found, parents, each)) for value, parent, each in wanted]
    for costly in (0, 1, 2):
        reached = found.best.log_marginal - best
        now = [Trial(p, e) for v, p, e in chosen if e.costly == costly and (not costly or v > reached - HARDLY_EVER)]
        try_sets(found, now, bandwidth)


def _with_starts_of(found: Explored, parents: Sequence[Explanation], proposal: Proposal) -> Proposal:
    """A proposal of one effect, with the starts that it has beside other parents too.

    Where a model lacks much, only behind a fast observer its motion is that of the log.
    """
    if len(proposal.names) > 1 or proposal.chaotic:
        return proposal
    every = (each.starts[0] for parent in parents for each in proposals(found, parent) if each.names == proposal.names)
    return replace(proposal, starts=(tuple(dict.fromkeys((*proposal.starts[0], *chain.from_iterable(every)))),))


def rise(found: Explored, parent: Explanation, parents: Sequence[Explanation]) -> None:
    """Fit each effect beside a set, and weigh those that are worth most by that, from the starts beside all parents.

    A promise is linear. It is worth nothing where the model is so poor that its inertia is that of friction, or that
    its observer and the discrepancy have taken the missing torque over.
    """
    asked = [_with_starts_of(found, parents, each) for each in proposals(found, parent) if not each.costly]
    gains = in_threads(lambda each: found.gained(parent.fit, each), asked)
    worth = {each.names: each.worth(gain) for each, gain in zip(asked, gains, strict=True)}
    rising = [each for each in asked if worth[each.names] > 0.0]
    rising.sort(key=lambda each: -worth[each.names])
    try_sets(
        found, [Trial(parent, each) for each in rising[: 2 * ASKED]]
    )  # a wider form may stand before what is there


def try_sets(found: Explored, trials: Sequence[Trial], bandwidth: float = np.inf) -> None:
    """Fit some sets, also behind another observer."""
    new = [each for each in trials if (each.names, each.parent.fit.bandwidth) not in found.fits]
    chosen = list({(each.names, each.parent.fit.bandwidth): each for each in reversed(new)}.values())[::-1]
    for names in dict.fromkeys(each.parent.names for each in chosen):
        told = "; ".join(" and ".join(sorted(each.proposal.names)) for each in chosen if each.parent.names == names)
        found.tell(f"beside {', '.join(sorted(names)) or 'nothing'}: {told}")
    loose = [each for each in chosen if not each.proposal.chaotic]
    found.add(chain.from_iterable(in_threads(lambda each: list(_tried(found, each, bandwidth)), loose)))
    held: dict[frozenset[str], list[Trial]] = {}
    for each in chosen:
        if each.proposal.chaotic:
            held.setdefault(each.parent.names, []).append(each)
    for beside in held.values():  # each takes as long as all others
        _try_held(found, min(beside, key=lambda each: len(each.proposal.names)))


def _tried(found: Explored, trial: Trial, bandwidth: float) -> Iterator[Explanation | None]:
    """One of them, behind the observer of what is there and a slower one; nothing where it says no more than that.

    Without an observer a fit may end astray; so where it is no better there, it begins behind that of the base model.
    """
    parent, proposal, least = trial.parent, trial.proposal, trial.least
    fit = found.fitted_with(parent.fit, proposal, parent.fit.bandwidth, least)
    if fit.log_likelihood <= parent.fit.log_likelihood + _NOTHING:
        if parent.fit.bandwidth < found.null.bandwidth and not found.held:
            begun = found.weighed(found.fitted_with(parent.fit, proposal, found.null.bandwidth))
            if begun is not None:
                yield begun
                yield from with_other_observers(found, begun)
        return
    weighed = found.weighed(fit)
    yield weighed
    if bandwidth < fit.bandwidth and fit.log_likelihood >= parent.fit.log_likelihood + least:
        yield found.weighed(found.fitted(fit, [fit.model], bandwidth))
    if weighed is None and len(proposal.starts) > 1:  # where two do not get on, each is asked alone
        for starts in proposal.starts:
            yield from _tried(found, replace(trial, proposal=replace(proposal, starts=(starts,))), bandwidth)


def _try_held(found: Explored, trial: Trial) -> None:
    """A set in which small errors grow without bound: it is weighed behind an observer that holds it.

    Where it is likelier there than the best of the others, all go on behind that observer, with those that compete.
    """
    parent = trial.parent.fit
    bandwidth = max(HELD / found.null.log.sample_time, parent.bandwidth)
    tried = found.weighed(found.fitted_with(parent, trial.proposal, bandwidth))
    if found.held or tried is None:
        found.add([tried])
        return
    others = _competing(found, bandwidth)
    if all(tried.log_marginal > other.log_marginal for other in others):
        found.held, found.fits = True, {}
        alone = found.weighed(found.fitted(found.null, [found.null.model], bandwidth))
        found.add((tried, *others, alone or found.weighed(found.null)))


def _competing(found: Explored, bandwidth: float) -> list[Explanation]:
    """The likeliest sets behind another observer: the first that has a fit there, and what it competes with."""
    others, least = list[Explanation](), -np.inf
    for each in sorted(found.known.values(), key=lambda each: -each.log_marginal):
        if each.log_marginal < least:
            break
        other = found.weighed(found.fitted(each.fit, [each.fit.model], bandwidth))
        if other is not None:
            others.append(other)
            least = max(least, each.log_marginal - HARDLY_EVER)
    return others


def _would_add(fit: Fit, kind: type[Effect]) -> bool:
    excluded = any(kind.excludes(type(effect)) for effect in fit.model.effects)
    return fit.log.shows(kind) and not excluded and not fit.model.holds(kind.name)


def with_other_observers(found: Explored, best: Explanation) -> Iterator[Explanation]:
    """A set behind slower and slower observers, as long as it gets likelier; the one before the last is best.

    None is faster than the base model needs, behind which innovations have a colour, which the discrepancy explains.
    But the noise of a measured torque is one that nothing predicts, so that one observer suits it. Where there is one,
    they are also faster, as long as the likelihood without a discrepancy rises as much, and then in between.
    """
    measured = best.fit.model.lead() is not None
    fastest = np.inf if measured else found.null.bandwidth
    for ratio in (1.0 / STEP, STEP, STEP**-0.5, STEP**0.5) if measured else (1.0 / STEP,):
        while 0.0 < best.fit.bandwidth * ratio <= fastest:
            moved = _behind(found, best, best.fit.bandwidth * ratio)
            if moved is None or (ratio > 1.0 and _gained(best, moved) < moved.log_marginal - best.log_marginal):
                break
            yield moved
            if moved.log_marginal <= best.log_marginal:
                break
            best = moved


def _behind(found: Explored, explanation: Explanation, bandwidth: float) -> Explanation | None:
    """The same set behind another observer; behind none where that is slower than the slowest."""
    slowest = found.null.bandwidth / STEP**_STEPS
    fit = found.fitted(explanation.fit, [explanation.fit.model], bandwidth if bandwidth > slowest else 0.0)
    return found.weighed(fit)


def _gained(before: Explanation, after: Explanation) -> float:
    """Log-likelihood without a discrepancy."""
    return after.fit.log_likelihood - before.fit.log_likelihood
