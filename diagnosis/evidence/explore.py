"""The search over sets of effects: from the best few sets to those with one more, one less or one other.

Each set is fitted exactly and weighed beside the discrepancy. Which names are worth a fit says the score test at the
sets known so far, with the discrepancy and without it: beside a discrepancy as large as a missing effect, the effect
brings nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

from diagnosis.evidence.marginal import Explanation, weigh
from diagnosis.look_alikes import refined
from diagnosis.nuisance import Nuisance
from diagnosis.refit import fitted_near, is_its_special_case, refit
from diagnosis.screen import Suspect
from identification.errors import Unidentifiable
from identification.fit_result import Fit
from identification.side_by_side import side_by_side, without_blas_threads
from plant.effects import Effect

_BEAM = 2  # sets that are extended at each size
_ASKED = 5  # names that are tried beside a set
_MOST = 5  # names in a set
_PROMISING = 1.0  # rise of the log-likelihood from which a name is worth a fit
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

    def of_size(self, size: int) -> list[Explanation]:
        """The likeliest few with so many names."""
        those = [each for each in self.known.values() if len(each.names) == size]
        return sorted(those, key=lambda each: -each.log_marginal)[:_BEAM]

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
    for size in range(_MOST):
        before = found.best.log_marginal
        for parent in found.of_size(size):
            _extend(found, parent)
        if found.best.log_marginal <= before:
            break
    for _ in range(_MOST):
        best = found.best
        for name in sorted(best.names):
            _reduce(found, best, name)
        if found.best is best or found.best.names == best.names:
            break
    return found


def _extend(found: Explored, parent: Explanation) -> None:
    """Fit a set with one name more, for those that promise most."""
    asked = {n: kind for n, kind in found.effects.items() if _would_add(parent.fit, kind)}
    chosen = [s for s in _suspects(parent, asked) if parent.names | {s.name} not in found.known]
    found.tell(f"beside {', '.join(sorted(parent.names)) or 'nothing'}: {', '.join(s.name for s in chosen)}")
    _fitted(found, parent, chosen)


def _reduce(found: Explored, best: Explanation, name: str) -> None:
    """A set with one name less, and with another in its place."""
    less = best.names - {name}
    if less not in found.known:
        fit = fitted_near(best.fit, best.fit.model.without_effect(name))
        found.add([weigh(fit, _base_names(found), catalogue=len(found.effects))])
    if less in found.known:
        _extend(found, found.known[less])


def _fitted(found: Explored, parent: Explanation, suspects: list[Suspect]) -> None:
    base, count = _base_names(found), len(found.effects)
    fits = side_by_side(lambda suspect: refit(parent.fit, *suspect.starts), suspects)
    asked = list(zip(suspects, fits, strict=True))
    least = found.base.fit.log_likelihood
    most = max([found.best.fit.log_likelihood, *(fit.log_likelihood for fit in fits)]) - least
    close = most - max(_CLOSE[0], _CLOSE[1] * most)

    def one(pair: tuple[Suspect, Fit]) -> Explanation | None:
        suspect, fit = pair
        if fit.log_likelihood - least > close and suspect.starts[0].look_alikes(0):
            fit = refined(parent.fit, fit, suspect.name)
        if fit.runs_off or not fit.converged or is_its_special_case(fit, suspect.name):
            return None
        return weigh(fit, base, catalogue=count)

    found.add(side_by_side(one, asked))


def _suspects(parent: Explanation, asked: Mapping[str, type[Effect]]) -> list[Suspect]:
    """Those that promise most beside the discrepancy, and those that do without it."""
    plain = Nuisance(own=parent.discrepancy.own, shared=parent.discrepancy.shared)
    beside, alone = parent.screen.ask(asked), replace(parent.screen, nuisance=plain).ask(asked)
    chosen: dict[str, Suspect] = {}
    for first, second in zip(alone, beside, strict=True):
        for suspect in (first, second):
            if suspect.evidence > _PROMISING and len(chosen) < _ASKED:
                chosen.setdefault(suspect.name, suspect)
    return list(chosen.values())


def _base_names(found: Explored) -> set[str]:
    return {effect.name for effect in found.base.fit.model.effects}


def _would_add(fit: Fit, kind: type[Effect]) -> bool:
    drivetrain = fit.model.drivetrain
    return not fit.model.holds(kind.name) and fit.log.shows(kind) and not (kind.flexible and drivetrain is not None)
