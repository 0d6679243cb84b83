"""Whether names are to be believed, or what has no name: both explain the same log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

from scipy.special import expit

from diagnosis.model_probability import CLEAR, search_charge
from diagnosis.nonparametric_residual import (
    CLEARLY,
    ResidualModel,
    beside_unnamed,
    best_curve_score,
    charged_evidence,
    curve_path,
    evidence_lead,
    is_clearly_likelier,
    residual_model,
)
from diagnosis.parts_consistency import still_needed
from diagnosis.random_walk_load import may_be_random_walk, refitted_path, with_lower_probability
from diagnosis.refit import fitted_near, is_plausible
from diagnosis.stepwise_round import Addition
from diagnosis.stepwise_search import Outcome
from identification.fit_result import Fit
from plant.effects.nonparametric import plain

_PROMISING = 0.1  # share of what names explain that the screen has to give to what is richer, for it to be fitted
_FAR = 2.0  # times what names explain, from which on nothing that is done to them makes up for it
_TOGETHER = 2  # names in whose place what has none is looked for: one alone is likelier than what is as good


def curves_explain_far_more(outcome: Outcome) -> bool:
    """Whether names need not even be weighed: what has no name explains far more by itself, and leaves nothing.

    One name is weighed sooner than this is asked. Nor is it asked where an observer follows anything, which hides who
    explains what, nor where an effect is chaotic.
    """
    if len(outcome.additions) < _TOGETHER or not may_be_random_walk(outcome.fit) or outcome.fit.model.chaotic:
        return False
    alone = residual_model(outcome.base).path
    leaves_nothing = bool(alone) and not alone[-1].bandwidth
    return leaves_nothing and is_clearly_likelier(alone, (outcome.fit,), outcome.base, times=_FAR)


def supported_effects(outcome: Outcome) -> tuple[Outcome, ResidualModel, list[str]]:
    """What the search found, as far as it is to be believed, what is carried without a name beside it, and doubts."""
    curves = cache(partial(curve_path, outcome.base))
    return _several(*_beside_curves(_without_strange(outcome), curves), curves)


def _without_strange(outcome: Outcome) -> Outcome:
    """The names without those whose causes hardly ever have the values that came out, if they leave an observer work.

    A spring that pushes away is believed where nothing is left to explain. Where much is, it only stands for what has
    no name, and names that were found beside it have to pay without it.
    """
    kept, at, gone = list(outcome.additions), outcome.fit, list[str]()
    while at.bandwidth and (strange := [addition.effect for addition in kept if not is_plausible(at, addition.effect)]):
        gone += strange
        for name in strange:
            at = fitted_near(at, at.model.without_effect(name))
        kept, at = still_needed([addition for addition in kept if addition.effect not in strange], at)
    return (
        replace(outcome, additions=tuple(refitted_path(outcome.base, kept, at)), strange=tuple(gone))
        if gone
        else outcome
    )


def _beside_curves(outcome: Outcome, curves: Callable[[], tuple[Fit, ...]]) -> tuple[Outcome, ResidualModel]:
    """The names unless curves explain clearly more, and what is carried.

    Names that explain clearly less than curves do by themselves only stand near the cause: what carries the gain is
    what the log shows. They stay where, with what is carried beside them, they explain clearly more than that: then
    something is missing that has a name, and something that has none. Names that leave nothing stay too, or little: if
    with what is richer beside them they do not explain clearly more, it does not without them. Unless one came out with
    values such as its cause can hardly have: then they have to explain clearly more by themselves. What is richer than
    a curve is asked alone where it is needed beside the names, or where they leave much to an observer; there it has to
    explain twice as much.
    """
    additions, beside = beside_unnamed(outcome.base, outcome.additions)
    strange = not all(is_plausible(outcome.fit, addition.effect) for addition in outcome.additions)
    names, enough = (outcome.fit,), 1.0 - CLEARLY if strange else 1.0 + CLEARLY
    little = beside.rich and not is_clearly_likelier(beside.path, names, outcome.base, times=enough)
    if outcome.additions and not little and (beside.path or beside.seen or outcome.fit.bandwidth or strange):
        alone = residual_model(outcome.base).path if beside.rich else curves()
        if (
            not beside.rich
            and outcome.fit.bandwidth
            and not is_clearly_likelier(alone, names, outcome.base, times=enough)
        ):
            promising = best_curve_score(outcome.base) > _PROMISING * charged_evidence(names, outcome.base)
            alone, enough = residual_model(outcome.base).path if promising else (), 2.0
        near = bool(alone) and is_clearly_likelier(alone, names, outcome.base, times=enough)
        if near and (strange or not is_clearly_likelier(beside.path, alone, outcome.base, times=1.0 + CLEARLY)):
            return replace(outcome, additions=()), ResidualModel(path=alone, seen=())
    return replace(outcome, additions=additions), beside


def _several(
    outcome: Outcome, beside: ResidualModel, curves: Callable[[], tuple[Fit, ...]]
) -> tuple[Outcome, ResidualModel, list[str]]:
    """Several names with the odds that are left to them by a curve which explains as much by itself, and that said.

    Each name pays for having been found in the catalogue, and a curve for its variable. Names that then are unlikely
    only stand near the cause: the curve takes their place.
    """
    alone = curves() if len(outcome.additions) >= _TOGETHER else ()
    if not alone:
        return outcome, beside, []
    variables = search_charge(searched=1, catalogue=len(plain))
    paid = sum(_charge(addition) for addition in outcome.additions) + variables * (len(beside.path) - len(alone))
    sure = float(expit(evidence_lead(beside.path or (outcome.fit,), alone, outcome.base) - paid))
    if sure >= CLEAR:
        return outcome, beside, []
    if sure < 1.0 - CLEAR:
        return replace(outcome, additions=()), ResidualModel(path=alone, seen=()), []
    titles = [effect.title for effect in alone[-1].model.effects if outcome.base.model.effect(effect.name) is None]
    explain = "explains" if len(titles) == 1 else "explain"
    told = f"{' and '.join(titles)} alone {explain} as much as these effects together"
    additions = tuple(with_lower_probability(addition, sure) for addition in outcome.additions)
    said = f"{told[0].upper()}{told[1:]}; a log with a different motion would decide."
    return replace(outcome, additions=additions), beside, [said]


def _charge(addition: Addition) -> float:
    """What an addition's name pays for its search."""
    return next((rival.charge for rival in addition.contest if rival.effect.name == addition.effect), 0.0)
