"""Why an effect is named, or none: the evidence, the competing hypotheses, where it shows, what may be hidden."""

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
    rise,
    sentence_case,
    size,
    strength,
    title_of,
    torque_or_force,
)
from diagnosis.model_probability import CLEAR, NONE
from diagnosis.result import Cause, Findings

_ONE_MOMENT = 0.5  # share of the evidence from one tenth of the log that calls for a look at it
_OPEN = 0.01  # probability from which a rival is named among those that the log cannot tell apart


@dataclass(frozen=True, kw_only=True, eq=False)
class Reason:
    """Why an effect is named, or why none is.

    Attributes:
        title: what is explained.
        effect: its name; None where no effect is named.
        sentences: the explanation, the evidence first.
        contest: its competing hypotheses; None where they are not on record.
        cumulative_evidence: where along the log its evidence comes from; None where nothing was added.
        residual_over_variable: where the residual torque shows it; None where it does not.
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
        lost = rise(extended.log_likelihood - other.log_likelihood)
        lines.append(f"Without it, all else fitted again, the log-likelihood of the extended model falls by {lost}.")
    if cause.parameters:
        lines.append(f"Its parameters: {size(cause.parameters.items())}.")
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
    """The evidence for an effect, against the runner-up where there is one."""
    name, lead, second = title_of(cause.effect, diagnosis), contest.leader, contest.runner_up
    raised = f"{sentence_case(name)} raises the log-likelihood by {rise(lead.evidence)}"
    if contest.round == AGAIN:
        if second is None:
            return f"Beside all other effects found, {name} raises the log-likelihood by {rise(lead.evidence)}."
        return (
            f"Beside all other effects found, {name} raises the log-likelihood by {rise(lead.evidence)}. The evidence "
            f"against the runner-up, {title_of(second.effect, diagnosis)}, is {strength(lead.score - second.score)}."
        )
    if second is None or second.effect == NONE:
        return (
            f"{raised}; no other effect comes near. Less a charge of {lead.evidence - lead.visible:.3g} for its "
            f"parameters and the search, the evidence that it is missing is {strength(contest.something)}."
        )
    rival = title_of(second.effect, diagnosis)
    return (
        f"{raised}, the runner-up, {rival}, by {rise(second.evidence)}. Less the charges for parameters and the "
        f"search, the evidence for {name} against {rival} is {strength(lead.score - second.score)}."
    )


def _field(diagnosis: Findings, cause: Cause, contest: HypothesisComparison) -> list[str]:
    """The competing hypotheses."""
    lines = []
    if contest.leader.effect != cause.effect:
        won = title_of(contest.leader.effect, diagnosis)
        lines.append(f"It was found as {won}. Beside the effects found later only this special case is still needed.")
    alike = [title_of(name, diagnosis) for name in contest.alike if name != cause.effect]
    if alike:
        fit = "fits" if len(alike) == 1 else "fit"
        lines.append(
            f"{sentence_case(joined_words(alike))} {fit} no better: the parameters that make the difference are zero "
            "or undetermined."
        )
    if strange := [title_of(name, diagnosis) for name in contest.strange]:
        lines.append(
            f"{sentence_case(joined_words(strange))}: such a cause hardly ever has the fitted values, "
            "so its probability is lowered."
        )
    if contest.screened:
        best = contest.screened[0]
        lines.append(
            f"In round {contest.round} of the search {contest.fitted} of {contest.asked} effects were fitted. Of those "
            f"that the score test ruled out, {title_of(best.effect, diagnosis)} promised most ({best.evidence:+.3g})."
        )
    return lines


def _over(diagnosis: Findings, cause: Cause, seen: ResidualOverVariable | None) -> str:
    """Where it shows, beside the signature that is expected of it."""
    kind = effect_of(diagnosis, cause.effect)
    expected = f"Its signature: {kind.trace}. " if kind is not None else ""
    if seen is None:
        lacked = torque_or_force(diagnosis.residual_before.unit)
        return f"{expected}The residual {lacked} shows it over no single variable; the one-step predictions do."
    weak = "" if seen.standing_out else "; the one-step predictions show it more clearly"
    return (
        f"{expected}It shows over {seen.variable}: in {seen.standing_out} of {seen.centre.size} intervals the residual "
        f"differs from zero by more than its 95 % error{weak}."
    )


def _along(grown: CumulativeEvidence) -> str:
    """Whether the evidence rests on one moment."""
    share, moment = grown.densest
    if share < _ONE_MOMENT:
        return f"The evidence comes from the whole log; no tenth of it gives more than {percent(share)}."
    return (
        f"{percent(share)} of the evidence comes from one tenth of the log, around {moment:.3g} s. Look there for a "
        "fault in the data before you use the result."
    )


def _torn(diagnosis: Findings, cause: Cause, experiment: Experiment | None) -> list[str]:
    """Why the data cannot tell, and what could."""
    kind = effect_of(diagnosis, cause.effect)
    rivals = [name for name, share in cause.alternatives if share > _OPEN]
    names = joined_words([title_of(name, diagnosis) for name in (cause.effect, *rivals)])
    needed = percent(CLEAR)
    lines = []
    if rivals:
        lines.append(
            f"This log does not tell {names} apart. An effect is named alone if its probability is above {needed}."
        )
    if cause.missing < CLEAR and diagnosis.unknown.likelier_than(1.0 - CLEAR):
        lines.append(
            f"What no effect explains is about as large as {title_of(cause.effect, diagnosis)}, which may be a part of "
            "that. A motion in which the effect shows more would decide."
        )
    elif cause.missing < CLEAR:
        lines.append(
            f"The probability that no effect is missing is {percent(1.0 - cause.missing)}. A longer log would decide, "
            "or a motion in which the effect shows more."
        )
    for other in (effect_of(diagnosis, name) for name in rivals):
        if kind is not None and other is not None:
            known = other.name in kind.confused_with or kind.name in other.confused_with
            look = "; the two are known to be confounded" if known else ""
            lines.append(f"The signature of {other.title} would be: {other.trace}{look}.")
    return lines if experiment is None else [*lines, str(experiment)]


def reason_for_none(diagnosis: Findings) -> Reason:
    """Why a diagnosis gives no name."""
    rounds = sorted({c.round for c in diagnosis.candidates})
    if not rounds:
        return Reason(title="Why no effect is named", effect=None, sentences=("No effect was tried.",))
    first = HypothesisComparison.of_round(diagnosis.candidates, rounds[0])
    if diagnosis.verdict == "nothing_missing":
        lines = [_not_needed(diagnosis, first), *_could_hide(diagnosis, first)]
        return Reason(title="Why no effect is named", effect=None, sentences=tuple(lines), contest=first)
    lines = [_not_believed(diagnosis, first)]
    grown = seen = None
    if diagnosis.extended is not diagnosis.base:
        base, extended = diagnosis.base, diagnosis.extended
        carried = [effect.title for effect in extended.model.effects if base.model.effect(effect.name) is None]
        more = rise(extended.log_likelihood - base.log_likelihood)
        grown, seen = cumulative_evidence(base, extended), residual_over_variable(base, extended)
        lines += [f"A {joined_words(carried)} raises the log-likelihood by {more}.", _along(grown)]
    title = "Why no effect is named"
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
        return f"{contest.asked} effects were tried, and none explains more than the model does."
    return (
        f"{contest.asked} effects were tried. The best, {title_of(best.effect, diagnosis)}, raises the log-likelihood "
        f"by {best.evidence:.3g}; its parameters and the search cost {best.evidence - best.visible:.3g}."
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
        return "No effect that was tried explains the residual torque."
    led = f"The best effect, {title_of(best.effect, diagnosis)}, raises the log-likelihood by {rise(best.evidence)}"
    if contest.something < NOTICED:
        return (
            f"{led}; its parameters and the search cost {best.evidence - best.visible:.3g}. The evidence that any "
            f"effect is missing is {strength(contest.something)}; a log Bayes factor of {NOTICED:.3g} is needed."
        )
    return (
        f"{led}, but it is rejected: in validation the model with it is no better, or something else explains as much."
    )
