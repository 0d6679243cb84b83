"""The search over sets of effects: from the best set to those with one or two more, one less or one other.

Each set is fitted exactly and weighed beside the discrepancy. Noise is a model of its own: all sets that are compared
are predicted by one observer, whose bandwidth is the likeliest for the best of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

from diagnosis.evidence.marginal import Explanation, weigh
from diagnosis.evidence.signatures import Proposal, Signatures
from diagnosis.refit import is_its_special_case, most_promising, problem_near
from identification.certainty import fit_of
from identification.errors import Unidentifiable
from identification.fit_result import Fit
from identification.predictor import HELD
from identification.side_by_side import side_by_side, without_blas_threads
from plant.effects import Effect
from plant.servo import ServoModel

_ASKED = 5  # sets that are tried beside a set
_IN_PLACE = 2  # and in the place of one name
_MOST = 5  # times that names are added
_STEP, _STEPS = 4.0, 4  # from bandwidth to bandwidth, and how many below that of the base model alone
_STAGES = (0, 1, 2, 2)  # of a search among shapes that look alike
_ITERATIONS = 20


@dataclass(eq=False)
class Explored:
    """The sets that were fitted, by their names, all at one bandwidth of the observer [rad/s]."""

    null: Fit
    effects: Mapping[str, type[Effect]]
    tell: Callable[[str], None]
    bandwidth: float
    known: dict[frozenset[str], Explanation] = field(default_factory=dict)

    @property
    def best(self) -> Explanation:
        """The likeliest."""
        return max(self.known.values(), key=lambda each: each.log_marginal)

    def add(self, explanations: Iterable[Explanation | None]) -> None:
        """Keep the better fit of each set."""
        for each in filter(None, explanations):
            at_hand = self.known.get(each.names)
            if at_hand is None or each.log_marginal > at_hand.log_marginal:
                self.known[each.names] = each

    def weighed(self, fit: Fit) -> Explanation | None:
        """A fit as an explanation; None where it is none, or says what a simpler set says too."""
        held = {effect.name for effect in self.null.model.effects}
        names = {effect.name for effect in fit.model.effects} - held
        if not fit.converged or any(is_its_special_case(fit, name) for name in names):
            return None
        return weigh(fit, held, catalogue=len(self.effects))


@without_blas_threads
def explore(null: Fit, effects: Mapping[str, type[Effect]], progress: Callable[[str], None] | None = None) -> Explored:
    """All sets worth a look beyond a fitted base model."""
    found = Explored(null=null, effects=effects, tell=progress or (lambda line: None), bandwidth=null.bandwidth)
    grid = {0.0, *(null.bandwidth / _STEP**step for step in range(_STEPS))}
    at_each = side_by_side(lambda bandwidth: found.weighed(_fitted(null, [null.model], bandwidth)), sorted(grid))
    roots = [root for root in at_each if root is not None]
    if not roots:
        raise Unidentifiable("The motion of the base model grows without bound.")
    _begin_at(found, max(roots, key=lambda root: root.log_marginal))
    for _ in range(_MOST):
        best = found.best
        _extend(found, best, _ASKED)
        _without_each(found, found.best)
        if found.best is best:
            break
        _retune(found)
    best = found.best
    for name in sorted(best.names):
        if (less := found.known.get(best.names - {name})) is not None:
            _extend(found, less, _IN_PLACE)
    if found.best is not best:
        _without_each(found, found.best)
        _extend(found, found.best, _ASKED)
    return found


def _begin_at(found: Explored, best: Explanation) -> None:
    """Go on from one set, at its bandwidth; what was weighed at another cannot be compared."""
    found.bandwidth, found.known = best.fit.bandwidth, {best.names: best}


def _retune(found: Explored) -> None:
    """Lower the bandwidth to where the best set is likeliest: what is named or smooth is no observer's work.

    It never rises: behind an observer that is faster than the log asks for, innovations have a colour, which anything
    that carries the measurement's noise would explain.
    """
    best, slowest = found.best, found.null.bandwidth / _STEP**_STEPS
    while best.fit.bandwidth and not best.fit.model.chaotic:
        bandwidth = best.fit.bandwidth / _STEP
        moved = found.weighed(_fitted(best.fit, [best.fit.model], bandwidth if bandwidth > slowest else 0.0))
        if moved is None or moved.log_marginal <= best.log_marginal:
            break
        best = moved
    if best is not found.best:
        _begin_at(found, best)


def _extend(found: Explored, parent: Explanation, most: int) -> None:
    """Fit the sets with one or two names more that promise most."""
    asked = {n: kind for n, kind in found.effects.items() if _would_add(parent.fit, kind)}
    if not asked:
        return
    proposals = Signatures.at(parent, asked, len(found.effects)).proposals(most)
    chosen = [each for each in proposals if parent.names | each.names not in found.known]
    told = "; ".join(" and ".join(sorted(each.names)) for each in chosen)
    found.tell(f"beside {', '.join(sorted(parent.names)) or 'nothing'}: {told or 'nothing more'}")

    def one(proposal: Proposal) -> Explanation | None:
        return found.weighed(_with(parent.fit, proposal, found.bandwidth))

    held = [each for each in chosen if any(starts[0].chaotic for starts in each.starts)]
    found.add(side_by_side(one, [each for each in chosen if each not in held]))
    _try_held(found, parent, held)


def _try_held(found: Explored, parent: Explanation, proposals: list[Proposal]) -> None:
    """Sets in which small errors grow without bound: they are weighed behind an observer that holds them.

    Where such a set is likelier there than the best of the others, all go on behind that observer.
    """
    bandwidth = max(found.bandwidth, HELD / found.null.log.sample_time)
    if bandwidth == found.bandwidth:
        found.add(side_by_side(lambda each: found.weighed(_with(parent.fit, each, bandwidth)), proposals))
        return
    tried = [found.weighed(_with(parent.fit, each, bandwidth)) for each in proposals]
    loose = max((each for each in tried if each is not None), key=lambda each: each.log_marginal, default=None)
    if loose is None:
        return
    best = found.best
    rival = found.weighed(_fitted(best.fit, [best.fit.model], bandwidth))
    if rival is None or loose.log_marginal > rival.log_marginal:
        _begin_at(found, loose)
        found.add([rival])


def _with(fit: Fit, proposal: Proposal, bandwidth: float) -> Fit:
    """The model of a fit with what is proposed, fitted from there."""
    models = [fit.model]
    for starts in proposal.starts:
        models = [model.with_effect(start) for model in models for start in starts]
    found = _fitted(fit, models, bandwidth)
    for starts in proposal.starts:
        found = _among_look_alikes(found, starts[0].name, bandwidth)
    return found


def _fitted(start: Fit, models: list[ServoModel], bandwidth: float) -> Fit:
    """The best fit of some models at a bandwidth, from another fit."""
    near = replace(start, bandwidth=bandwidth)
    problems = [problem_near(start, model) for model in models]
    if len(problems) > 1:
        problems = most_promising(problems, near, bandwidth)[:1]
    (problem,) = problems
    begun = problem.begun(near)
    ended = problem.minimise(begun.point, bandwidth, 0.0, iterations=_ITERATIONS, at_start=begun.equations)
    return fit_of(problem, bandwidth, ended, begun.evaluations)


def _among_look_alikes(fit: Fit, name: str, bandwidth: float) -> Fit:
    """The best among shapes of an effect between which a descent cannot choose."""
    for stage in _STAGES:
        effect = fit.model.effect(name)
        alike = () if effect is None else effect.look_alikes(stage)
        if not alike:
            break
        rest = fit.model.without_effect(name)
        other = _fitted(replace(fit, model=rest), [rest.with_effect(each) for each in alike], bandwidth)
        fit = max((fit, other), key=lambda each: each.log_likelihood)
    return fit


def _without_each(found: Explored, best: Explanation) -> None:
    """The sets with one name less."""
    missing = [name for name in sorted(best.names) if best.names - {name} not in found.known]
    found.add(
        side_by_side(
            lambda name: found.weighed(_fitted(best.fit, [best.fit.model.without_effect(name)], found.bandwidth)),
            missing,
        )
    )


def _would_add(fit: Fit, kind: type[Effect]) -> bool:
    drivetrain = fit.model.drivetrain
    return not fit.model.holds(kind.name) and fit.log.shows(kind) and not (kind.flexible and drivetrain is not None)
