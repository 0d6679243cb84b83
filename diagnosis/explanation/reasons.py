"""Why one name was given, and why none was: the margin, the rivals, where it shows and what could still be hidden."""

from __future__ import annotations

from dataclasses import dataclass

from diagnosis.experiment import Experiment
from diagnosis.explanation.cumulative_evidence import (
    CumulativeEvidence,
    ResidualOverVariable,
    cumulative_evidence,
    residual_over_variable,
    without_cause,
)
from diagnosis.explanation.detectable import detectable
from diagnosis.explanation.hypothesis_comparison import AGAIN, NOTICED, HypothesisComparison, comparison_of
from diagnosis.explanation.wording import (
    effect_of,
    joined_words,
    percent,
    power,
    sentence_case,
    size,
    title_of,
    torque_or_force,
)
from diagnosis.model_probability import CLEAR, NONE
from diagnosis.result import Cause, Findings

_ONE_MOMENT = 0.5  # share of the evidence from one tenth of the log that calls for a look at it
_OPEN = 0.01  # probability from which a rival is named among those that the log cannot tell apart


@dataclass(frozen=True, kw_only=True, eq=False)
class Reason:
    """Why one name was given, or why none was.

    Attributes:
        title: what is explained.
        effect: the name; None where none was given.
        sentences: the explanation, the margin first.
        contest: how far it was ahead of its rivals; None where that is not on record.
        gathered: when its evidence came together; None where nothing was added.
        shown: where the missing torque shows it; None where it does not.
    """

    title: str
    effect: str | None
    sentences: tuple[str, ...]
    contest: HypothesisComparison | None = None
    cumulative_evidence: CumulativeEvidence | None = None
    residual_over_variable: ResidualOverVariable | None = None


def reason_for(diagnosis: Findings, cause: Cause, experiment: Experiment | None) -> Reason:
    """Why a cause bears its name.

    Args:
        diagnosis: that has found it.
        cause: one of its causes.
        experiment: that has been designed to tell its rivals apart, if any.
    """
    contest, extended = comparison_of(diagnosis, cause), diagnosis.extended
    alone = len(extended.model.effects) - len(diagnosis.base.model.effects) == 1
    other = diagnosis.base if alone else without_cause(extended, cause.effect)
    grown, seen = cumulative_evidence(other, extended), residual_over_variable(other, extended)
    lines = [_margin(diagnosis, cause, contest), *_field(diagnosis, cause, contest)]
    if not alone and contest.round != AGAIN:
        lost = extended.log_likelihood - other.log_likelihood
        lines.append(f"To take it out of the extended model, all else refitted, costs {lost:.4g} in log-likelihood.")
    if cause.parameters:
        lines.append(f"Its size, with standard errors: {size(cause.parameters.items())}.")
    lines += [_over(diagnosis, cause, seen), _along(grown)]
    if cause.probability < CLEAR:
        lines += _torn(diagnosis, cause, experiment)
    return Reason(
        title=f"Why {title_of(cause.effect, diagnosis)}",
        effect=cause.effect,
        sentences=tuple(lines),
        contest=contest,
        cumulative_evidence=grown,
        residual_over_variable=seen,
    )


def _margin(diagnosis: Findings, cause: Cause, contest: HypothesisComparison) -> str:
    """By how much a name is ahead of the runner-up, and how much of that is charge and not likelihood."""
    name, lead, second = title_of(cause.effect, diagnosis), contest.leader, contest.runner_up
    charge = lead.evidence - lead.score
    if contest.round == AGAIN:
        ahead = "no other effect comes near"
        if second is not None:
            odds = power(lead.score - second.score)
            ahead = f"the odds against the runner-up, {title_of(second.effect, diagnosis)}, are {odds} to 1"
        return (
            f"Beside all else that was found, the data are {power(lead.evidence)} times likelier with {name} than "
            f"without it, and {ahead}."
        )
    if second is None or second.effect == NONE:
        return (
            f"The data are {power(lead.evidence)} times likelier with {name} than without it, and no other effect came "
            f"near; as it pays {lead.evidence - lead.visible:.3g} for its parameters and the search, the odds are "
            f"{power(contest.something)} to 1."
        )
    rival, fit = title_of(second.effect, diagnosis), lead.evidence - second.evidence
    more = second.evidence - second.score - charge
    pays = (
        f"as {rival if more > 0.0 else name} pays {abs(more):.3g} more" if abs(more) >= 0.005 else "as both pay alike"
    )
    than = f"{name} than with the runner-up, {rival}" if fit >= 0.0 else f"the runner-up, {rival}, than with {name}"
    return (
        f"The data are {power(abs(fit))} times likelier with {than} (log-likelihood {lead.evidence:+.4g} against "
        f"{second.evidence:+.4g}); {pays} for parameters and search, the odds are {power(lead.score - second.score)} "
        f"to 1 for {name}."
    )


def _field(diagnosis: Findings, cause: Cause, contest: HypothesisComparison) -> list[str]:
    """Who else was in the race."""
    lines = []
    if contest.leader.effect != cause.effect:
        won = title_of(contest.leader.effect, diagnosis)
        lines.append(f"It won as {won}; beside what was found later, only this special case of it is still needed.")
    alike = [title_of(name, diagnosis) for name in contest.alike if name != cause.effect]
    if alike:
        fit = "fits as well but says" if len(alike) == 1 else "fit as well but say"
        lines.append(
            f"{sentence_case(joined_words(alike))} {fit} no more: what sets them apart came out as nothing or open."
        )
    if strange := [title_of(name, diagnosis) for name in contest.strange]:
        lines.append(
            f"{sentence_case(joined_words(strange))}: such a cause hardly ever has the fitted values, "
            "so its probability is lowered."
        )
    if contest.screened:
        best = contest.screened[0]
        lines.append(
            f"In round {contest.round} of the search {contest.fitted} of {contest.asked} effects earned a full fit; of "
            f"those that the screen put aside, {title_of(best.effect, diagnosis)} promised most ({best.evidence:+.3g})."
        )
    return lines


def _over(diagnosis: Findings, cause: Cause, seen: ResidualOverVariable | None) -> str:
    """Where it shows, beside what its file says of its trace."""
    kind = effect_of(diagnosis, cause.effect)
    expected = f"Its mark: {kind.trace}. " if kind is not None else ""
    if seen is None:
        lacked = torque_or_force(diagnosis.residual_before.unit)
        return f"{expected}The filtered missing {lacked} shows it over no single variable; the predictions tell it."
    weak = "" if seen.standing_out else ": the predictions tell it, not this picture"
    return (
        f"{expected}It shows over {seen.variable}, where it stands out of the 95 % band in {seen.standing_out} of "
        f"{seen.centre.size} intervals{weak}."
    )


def _along(grown: CumulativeEvidence) -> str:
    """Whether the evidence rests on one moment."""
    share, moment = grown.densest
    if share < _ONE_MOMENT:
        return f"The evidence comes from the whole log; the richest tenth of it gives {percent(share)}."
    return (
        f"{percent(share)} of the evidence comes from one tenth of the log, around {moment:.3g} s: look there for a "
        "fault of the data before you believe the name."
    )


def _torn(diagnosis: Findings, cause: Cause, experiment: Experiment | None) -> list[str]:
    """Why the data cannot tell, and what could."""
    kind = effect_of(diagnosis, cause.effect)
    rivals = [name for name, share in cause.alternatives if share > _OPEN]
    names = joined_words([title_of(name, diagnosis) for name in (cause.effect, *rivals)])
    needed = f"{CLEAR / (1.0 - CLEAR):.2g} to 1"
    lines = []
    if rivals:
        lines.append(
            f"A name stands alone from {needed} against all others together: this log does not tell {names} apart."
        )
    if cause.missing < CLEAR:
        lines.append(
            f"That nothing is missing at all has {percent(1.0 - cause.missing)}; a name stands alone from {needed} "
            "against that too. A longer log would tell, or motion in which it shows more."
        )
    for other in (effect_of(diagnosis, name) for name in rivals):
        if kind is not None and other is not None:
            known = other.name in kind.confused_with or kind.name in other.confused_with
            look = "; the two are known to look alike" if known else ""
            lines.append(f"The mark of {other.title} would be: {other.trace}{look}.")
    return lines if experiment is None else [*lines, str(experiment)]


def reason_for_none(diagnosis: Findings) -> Reason:
    """Why a diagnosis gives no name."""
    rounds = sorted({c.round for c in diagnosis.candidates})
    if not rounds:
        return Reason(title="Why no name is given", effect=None, sentences=("No effect was asked.",))
    first = HypothesisComparison.of_round(diagnosis.candidates, rounds[0])
    if diagnosis.verdict == "nothing_missing":
        lines = [_not_needed(diagnosis, first), *_could_hide(diagnosis, first)]
        return Reason(title="Why nothing is named", effect=None, sentences=tuple(lines), contest=first)
    lines = [_not_believed(diagnosis, first)]
    grown = seen = None
    if diagnosis.extended is not diagnosis.base:
        base, extended = diagnosis.base, diagnosis.extended
        carried = [effect.title for effect in extended.model.effects if base.model.effect(effect.name) is None]
        rise = power(extended.log_likelihood - base.log_likelihood)
        grown, seen = cumulative_evidence(base, extended), residual_over_variable(base, extended)
        lines += [f"A {joined_words(carried)} without a name makes them {rise} times likelier.", _along(grown)]
    title = "Why no name is believed"
    return Reason(
        title=title,
        effect=None,
        sentences=tuple(lines),
        contest=first,
        cumulative_evidence=grown,
        residual_over_variable=seen,
    )


def _not_needed(diagnosis: Findings, contest: HypothesisComparison) -> str:
    best = contest.best
    if best is None:
        return f"{contest.asked} effects were asked, and none says more than the model does."
    return (
        f"{contest.asked} effects were asked; the best, {title_of(best.effect, diagnosis)}, raises the log-likelihood "
        f"by {best.evidence:.3g} and would pay {best.evidence - best.visible:.3g} for its parameters and the search."
    )


def _could_hide(diagnosis: Findings, contest: HypothesisComparison) -> list[str]:
    """How large an effect could have gone unnoticed."""
    sizes = detectable(diagnosis.base, (*contest.effects, *contest.screened))
    told = [f"{title_of(name, diagnosis)} {e.value:.2g} {e.unit}".removesuffix(" -") for name, e in sizes.items()]
    if not told:
        return []
    return [
        f"Smaller effects may be hidden. This log would show {joined_words(told, 'or')} one time in two; "
        "half as much hardly ever."
    ]


def _not_believed(diagnosis: Findings, contest: HypothesisComparison) -> str:
    best = contest.best
    if best is None:
        return "Nothing that was asked explains what is missing."
    led = f"The best name, {title_of(best.effect, diagnosis)}, makes the data {power(best.evidence)} times likelier"
    if contest.something < NOTICED:
        return (
            f"{led} and pays {best.evidence - best.visible:.3g} for its parameters and the search: the odds that any "
            f"effect of those asked is there are {power(contest.something)} to 1, and {power(NOTICED)} to 1 is needed."
        )
    return (
        f"{led}, but the model with it did not hold up in simulation, or on what it had not been fitted to, or what it "
        "explained is explained better without it."
    )
