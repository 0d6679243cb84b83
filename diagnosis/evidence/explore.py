"""The search over sets of effects: from the best few sets to those with one more, one less or one other.

Each set is fitted exactly and weighed beside the discrepancy. Which names are worth a fit says the score test at the
sets known so far, with the discrepancy and without it: beside a discrepancy as large as a missing effect, the effect
brings nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from diagnosis.evidence.marginal import Explanation, weigh
from diagnosis.evidence.signatures import Proposal, Signatures
from diagnosis.look_alikes import refined
from diagnosis.refit import fitted_near, is_its_special_case, problem_near, refit
from identification.errors import Unidentifiable
from identification.fit_result import Fit
from identification.side_by_side import side_by_side, without_blas_threads
from plant.effects import Effect

_ASKED = 5  # sets that are tried beside a set
_IN_PLACE = 2  # and in the place of one name
_MOST = 4  # times that names are added
_CLOSE = (100.0, 0.3)  # behind the best, in evidence or as a share of it: look-alike shapes may still win


@dataclass(eq=False)
class Explored:
    """The sets that were fitted, by their names."""

    base: Explanation
    effects: Mapping[str, type[Effect]]
    tell: Callable[[str], None]
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


@without_blas_threads
def explore(null: Fit, effects: Mapping[str, type[Effect]], progress: Callable[[str], None] | None = None) -> Explored:
    """All sets worth a look beyond a fitted base model."""
    held = {effect.name for effect in null.model.effects}
    root = weigh(null, held, catalogue=len(effects))
    if root is None:
        raise Unidentifiable("The motion of the base model grows without bound.")
    found = Explored(base=root, effects=effects, tell=progress or (lambda line: None), known={root.names: root})
    for _ in range(_MOST):
        best = found.best
        _extend(found, best, _ASKED)
        if found.best is best:
            break
    for _ in range(_MOST):
        best = found.best
        for name in sorted(best.names):
            _reduce(found, best, name)
        if found.best is best:
            break
        _extend(found, found.best, _ASKED)
    return found


def _extend(found: Explored, parent: Explanation, most: int) -> None:
    """Fit the sets with one or two names more that promise most."""
    asked = {n: kind for n, kind in found.effects.items() if _would_add(parent.fit, kind)}
    if not asked:
        return
    proposals = Signatures.at(parent, asked, len(found.effects)).proposals(most)
    chosen = [each for each in proposals if parent.names | each.names not in found.known]
    told = "; ".join(" and ".join(sorted(each.names)) for each in chosen)
    found.tell(f"beside {', '.join(sorted(parent.names)) or 'nothing'}: {told or 'nothing more'}")
    fits = side_by_side(lambda proposal: _fitted(parent.fit, proposal), chosen)
    least = found.base.fit.log_likelihood
    most_risen = max([found.best.fit.log_likelihood, *(fit.log_likelihood for fit in fits)]) - least
    close = most_risen - max(_CLOSE[0], _CLOSE[1] * most_risen)

    def weighed(pair: tuple[Proposal, Fit]) -> Explanation | None:
        proposal, fit = pair
        for starts in proposal.starts:
            if fit.log_likelihood - least > close and starts[0].look_alikes(0):
                fit = refined(parent.fit, fit, starts[0].name)
        if fit.runs_off or not fit.converged or any(is_its_special_case(fit, name) for name in proposal.names):
            return None
        return weigh(fit, _base_names(found), catalogue=len(found.effects))

    found.add(side_by_side(weighed, list(zip(chosen, fits, strict=True))))


def _fitted(fit: Fit, proposal: Proposal) -> Fit:
    """The model of a fit with what is proposed, fitted from there."""
    if len(proposal.starts) == 1:
        return refit(fit, *proposal.starts[0])
    model = fit.model
    for starts in proposal.starts:
        model = model.with_effect(starts[0])
    return problem_near(fit, model).descend(fit)


def _reduce(found: Explored, best: Explanation, name: str) -> None:
    """A set with one name less, and with another in its place."""
    less = best.names - {name}
    if less not in found.known:
        fit = fitted_near(best.fit, best.fit.model.without_effect(name))
        found.add([weigh(fit, _base_names(found), catalogue=len(found.effects))])
    if less in found.known:
        _extend(found, found.known[less], _IN_PLACE)


def _base_names(found: Explored) -> set[str]:
    return {effect.name for effect in found.base.fit.model.effects}


def _would_add(fit: Fit, kind: type[Effect]) -> bool:
    drivetrain = fit.model.drivetrain
    return not fit.model.holds(kind.name) and fit.log.shows(kind) and not (kind.flexible and drivetrain is not None)
