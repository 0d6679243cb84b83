"""The search: each round adds its winner and the superfluous is taken out; in the end all names are weighed again."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from diagnosis.agreement import agreed, disagreed_about
from diagnosis.backward import with_best_names, without_superfluous
from diagnosis.filtered import without_filters
from diagnosis.odds import CLEAR, SEEN
from diagnosis.refit import evidence_of
from diagnosis.result import Candidate
from diagnosis.round import Addition, one_round
from diagnosis.unseen import LOUD, holds_up
from diagnosis.wandering import without_wanderers
from identification.fit_result import Fit
from identification.problem import Problem
from plant.effects import Effect, catalogue

_ROUNDS = 6
_AHEAD = 1  # names that may fail to hold up unseen as long as the next mends it


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What the search found.

    Attributes:
        base: the fit that it started from, or a better one of the same model.
        additions: in order.
        candidates: everything that was tried.
        refused: names for which the log speaks loudly, but whose models did not hold up.
        wanderers: names that did no better than a load that wanders.
        filters: names that only mended the observer.
        uneven: names about which the parts of the log disagree: what is missing is something else.
        strange: names whose causes hardly ever have the values that came out.
    """

    base: Fit
    additions: tuple[Addition, ...]
    candidates: tuple[Candidate, ...]
    refused: tuple[str, ...] = ()
    wanderers: tuple[str, ...] = ()
    filters: tuple[str, ...] = ()
    uneven: tuple[str, ...] = ()
    strange: tuple[str, ...] = ()

    @property
    def fit(self) -> Fit:
        """The fit of the extended model."""
        return self.additions[-1].fit if self.additions else self.base


def forward(
    base: Fit, effects: Mapping[str, type[Effect]] = catalogue, *, progress: Callable[[str], None] | None = None
) -> Outcome:
    """Extend a fitted model by those of the effects that its log asks for, each as it was chosen when it was found.

    That anything is missing is told sooner than that something else is missing too: of a first name the odds say
    themselves how sure it is, and a doubtful companion would cast doubt on what is clear. Where several effects are
    missing, the first to be found may simulate worse than none at all; it stays as long as the next makes it hold up.
    """
    additions: list[Addition] = []
    firm: list[Addition] = []
    candidates: list[Candidate] = []
    fit = base
    for number in range(1, _ROUNDS + 1):
        bar = CLEAR if additions else SEEN
        found = one_round(fit, effects, number, candidates, progress, bar=bar)
        if found is None:
            break
        better = _better_null(fit, found)
        if better is not None:
            # The model at hand had only stopped at a poor optimum. Rivals that could win from there are asked again.
            gained = evidence_of(better, fit)
            base, fit = (better, better) if not additions else (base, better)
            if additions:
                additions[-1] = replace(additions[-1], fit=fit)
            if gained > min(found.lead, 0.5 * found.evidence):
                continue
            found = replace(found, evidence=evidence_of(found.fit, fit))
        additions.append(found)
        additions = without_superfluous(base, additions, effects, progress)
        fit = additions[-1].fit if additions else base
        held = firm[-1].fit if firm else base
        if additions and holds_up(held, fit):
            firm = list(additions)
        elif len(additions) > len(firm) + _AHEAD:
            break
    names = {addition.effect for addition in firm}
    refused = tuple(a.effect for a in additions if a.effect not in names and a.evidence > LOUD)
    return Outcome(base=base, additions=tuple(firm), candidates=tuple(candidates), refused=refused)


def weighed_again(outcome: Outcome, progress: Callable[[str], None] | None = None) -> Outcome:
    """What a search has found by the best names beside all others, without those that only seemed to be causes."""
    named = with_best_names(list(outcome.additions), progress)
    lasting = without_wanderers(outcome.base, named, progress)
    moving = without_filters(outcome.base, lasting, progress)
    kept = agreed(outcome.base, moving, progress)
    return replace(
        outcome,
        additions=tuple(kept),
        wanderers=_gone(named, lasting),
        filters=_gone(lasting, moving),
        uneven=disagreed_about(moving, _gone(moving, kept)),
    )


def _gone(before: list[Addition], after: list[Addition]) -> tuple[str, ...]:
    names = {addition.effect for addition in after}
    return tuple(addition.effect for addition in before if addition.effect not in names)


def _better_null(fit: Fit, found: Addition) -> Fit | None:
    """The model without the addition, fitted from the addition's optimum, if it is clearly likelier than it was."""
    problem = Problem.of(fit.log, fit.model, known=fit.known)
    here = problem.pack(fit.model.values, fit.initial)
    if problem.begun(replace(found.fit, bandwidth=fit.bandwidth)).is_at(here, fit.samples):
        return None
    again = problem.descend(found.fit)
    return again if evidence_of(again, fit) > 3.0 else None
