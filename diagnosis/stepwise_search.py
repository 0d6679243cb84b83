"""The search: each round adds its winner and the superfluous is taken out; in the end all names are weighed again."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from diagnosis.backward_elimination import backward_elimination, with_likeliest_effects
from diagnosis.model_probability import CLEAR, SEEN
from diagnosis.parts_consistency import consistent_additions, inconsistent_effects
from diagnosis.random_walk_load import without_random_walk_artefacts
from diagnosis.refit import evidence_of
from diagnosis.result import Candidate
from diagnosis.sensor_filters import without_sensor_filters
from diagnosis.stepwise_round import Addition, stepwise_round
from diagnosis.validation import LOUD, passes_validation
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
        random_walk_like: names that did no better than a load that wanders.
        filters: names that only mended the observer.
        inconsistent: names about which the parts of the log disagree: what is missing is another effect.
        strange: names whose causes hardly ever have the values that came out.
    """

    base: Fit
    additions: tuple[Addition, ...]
    candidates: tuple[Candidate, ...]
    refused: tuple[str, ...] = ()
    random_walk_like: tuple[str, ...] = ()
    filters: tuple[str, ...] = ()
    inconsistent: tuple[str, ...] = ()
    strange: tuple[str, ...] = ()

    @property
    def fit(self) -> Fit:
        """The fit of the extended model."""
        return self.additions[-1].fit if self.additions else self.base


def forward_selection(
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
        found = stepwise_round(fit, effects, number, candidates, progress, bar=bar)
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
        additions = backward_elimination(base, additions, effects, progress)
        fit = additions[-1].fit if additions else base
        held = firm[-1].fit if firm else base
        if additions and passes_validation(held, fit):
            firm = list(additions)
        elif len(additions) > len(firm) + _AHEAD:
            break
    names = {addition.effect for addition in firm}
    refused = tuple(a.effect for a in additions if a.effect not in names and a.evidence > LOUD)
    return Outcome(base=base, additions=tuple(firm), candidates=tuple(candidates), refused=refused)


def reselected(outcome: Outcome, progress: Callable[[str], None] | None = None) -> Outcome:
    """What a search has found by the best names beside all others, without those that only seemed to be causes."""
    named = with_likeliest_effects(list(outcome.additions), progress)
    lasting = without_random_walk_artefacts(outcome.base, named, progress)
    moving = without_sensor_filters(outcome.base, lasting, progress)
    kept = consistent_additions(outcome.base, moving, progress)
    return replace(
        outcome,
        additions=tuple(kept),
        random_walk_like=_gone(named, lasting),
        filters=_gone(lasting, moving),
        inconsistent=inconsistent_effects(moving, _gone(moving, kept)),
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
