"""Why an effect is reported, or none: the evidence, the residual torque, and the limits of detection."""

from __future__ import annotations

from dataclasses import dataclass

from diagnosis.experiment import Experiment
from diagnosis.explanation.cumulative_evidence import (
    CumulativeEvidence,
    ResidualOverVariable,
    cumulative_evidence,
    residual_over_variable,
)
from diagnosis.explanation.detectable import detectable
from diagnosis.explanation.posterior_sentences import unexplained
from diagnosis.explanation.wording import (
    change,
    effect_of,
    joined_words,
    measured,
    on_axis,
    percent,
    predicted,
    rise,
    size,
    strength,
    title_of,
    torque_or_force,
)
from diagnosis.levels import SURE
from diagnosis.refit import without
from diagnosis.result import Cause, Findings, Rejected
from identification.fit_result import Fit

_ONE_MOMENT = 0.5  # share of the evidence from one tenth of the log at which the user should check the data there
_OPEN = 0.01  # least probability of a competing effect that is listed


@dataclass(frozen=True, kw_only=True, eq=False)
class Reason:
    """Why an effect is reported, or why none is.

    Attributes:
        title: heading.
        effect: its name; None if no effect is reported.
        sentences: the explanation, the evidence first.
        cumulative_evidence: its evidence along the log; None if nothing was added or the motion without it diverges.
        residual_over_variable: the residual torque over the variable that shows it; None if none does.
    """

    title: str
    effect: str | None
    sentences: tuple[str, ...]
    cumulative_evidence: CumulativeEvidence | None = None
    residual_over_variable: ResidualOverVariable | None = None


def reason_for(diagnosis: Findings, cause: Cause, experiment: Experiment | None) -> Reason:
    """Why an effect is reported as a cause.

    Args:
        diagnosis: with this cause.
        cause: one of its causes.
        experiment: designed to separate the competing sets, if any.
    """
    after, before = _with_and_without(diagnosis, cause.effect)
    bounded = not before.runs_off
    grown = cumulative_evidence(before, after) if bounded else None
    seen = residual_over_variable(before, after) if bounded else None
    name, residual = title_of(cause.effect, diagnosis), diagnosis.residual_before
    lines = [
        f"The evidence for {name} is {strength(cause.log_bayes)}: the best set of effects with it against the best "
        "without it.",
        f"It explains a {torque_or_force(residual.unit)} of {measured(cause.rms, None, residual.unit)} rms, "
        f"{percent(cause.share)} of the power of the residual without it.",
    ]
    if cause.gain_std:
        went = "smaller" if cause.gain >= 0.0 else "larger"
        by = change(cause.gain, cause.gain_std)
        lines.append(f"On validation data the {predicted(diagnosis)} error is {by} {went} with it.")
    if cause.parameters:
        lines.append(f"Its parameters: {size(cause.parameters.items())}.")
    lines += [_over(diagnosis, cause, seen), _along(grown)]
    if cause.probability <= SURE:
        lines += _torn(diagnosis, cause, experiment)
    return Reason(
        title=f"Why {name}",
        effect=cause.effect,
        sentences=tuple(lines),
        cumulative_evidence=grown,
        residual_over_variable=seen,
    )


def _with_and_without(diagnosis: Findings, effect: str) -> tuple[Fit, Fit]:
    """Fits with and without an effect: of the extended model if it has the effect, else of the best set with it."""
    if effect in diagnosis.without:
        return diagnosis.extended, diagnosis.without[effect]
    holders = (each.fit for each in diagnosis.sets if effect in each.effects and each.fit is not None)
    holder = next(holders, diagnosis.extended)
    return holder, without(holder, effect, diagnosis.base.bandwidth)


def _over(diagnosis: Findings, cause: Cause, seen: ResidualOverVariable | None) -> str:
    """The expected signature of a cause, and the variable over which the residual torque shows it."""
    kind = effect_of(diagnosis, cause.effect)
    axis = diagnosis.base.log.axis
    expected = f"Its signature: {on_axis(kind.signature, axis)}. " if kind is not None else ""
    if seen is None:
        lacked = torque_or_force(diagnosis.residual_before.unit)
        return f"{expected}The residual {lacked} does not show it over one variable; the one-step predictions do."
    weak = "" if seen.standing_out else "; the one-step predictions show it more clearly"
    return (
        f"{expected}It shows over {seen.variable}: in {seen.standing_out} of {seen.centre.size} intervals the residual "
        f"differs from zero by more than its 95 % error{weak}."
    )


def _along(grown: CumulativeEvidence | None) -> str:
    """Whether the evidence comes from one moment or from the whole log."""
    if grown is None:
        return "Without it the motion of the model grows without bound."
    share, moment = grown.densest
    if share < _ONE_MOMENT:
        return f"The evidence comes from the whole log; no tenth of it gives more than {percent(share)}."
    return (
        f"{percent(share)} of the evidence comes from one tenth of the log, around {moment:.3g} s. Look there for a "
        "fault in the data before you use the result."
    )


def _torn(diagnosis: Findings, cause: Cause, experiment: Experiment | None) -> list[str]:
    """Why the data do not separate a cause from its alternatives, and which experiment could."""
    kind = effect_of(diagnosis, cause.effect)
    alternatives = [name for name, share in cause.alternatives if share > _OPEN]
    names = joined_words([title_of(name, diagnosis) for name in (cause.effect, *alternatives)])
    lines = []
    if alternatives:
        lines.append(
            f"This log does not tell {names} apart. An effect is named alone if its probability is above "
            f"{percent(SURE)}."
        )
    else:
        lines.append(
            f"The unexplained {torque_or_force(diagnosis.residual_before.unit)} is about as large as {names}, which "
            "may be part of it. Record a longer log, or a motion that excites the effect more."
        )
    for other in (effect_of(diagnosis, name) for name in alternatives):
        if kind is not None and other is not None:
            known = other.name in kind.confused_with or kind.name in other.confused_with
            look = "; the two are known to be confounded" if known else ""
            lines.append(
                f"The signature of {other.title} would be: {on_axis(other.signature, diagnosis.base.log.axis)}{look}."
            )
    return lines if experiment is None else [*lines, str(experiment)]


def reason_for_none(diagnosis: Findings) -> Reason:
    """Why a diagnosis reports no effect."""
    title = "Why no effect is named"
    tried = len(diagnosis.rejected) + len(diagnosis.minor)
    nearest = next((f" The nearest is {_rejected(diagnosis, each)}" for each in diagnosis.rejected), "")
    if diagnosis.verdict == "nothing_missing":
        lines = [
            f"{tried} effects were tried. None improves the fit enough to justify its parameters.{nearest}",
            *_could_hide(diagnosis),
        ]
        return Reason(title=title, effect=None, sentences=tuple(lines))
    unknown = max(diagnosis.unknown.probability, diagnosis.unknown.measurement_error)
    lines = [
        f"{tried} effects were tried. None is both probable and larger than what no effect explains: "
        f"{unexplained(diagnosis)} (probability {percent(unknown)}).{nearest}",
        *filter(None, (diagnosis.only_in_validation,)),
    ]
    grown = seen = None
    if diagnosis.extended is not diagnosis.base:
        base, extended = diagnosis.base, diagnosis.extended
        nonparametric = [effect.title for effect in extended.model.effects if base.model.effect(effect.name) is None]
        more = rise(extended.log_likelihood - base.log_likelihood)
        grown, seen = cumulative_evidence(base, extended), residual_over_variable(base, extended)
        lines += [f"A {joined_words(nonparametric)} raises the log-likelihood by {more}.", _along(grown)]
    return Reason(
        title=title,
        effect=None,
        sentences=tuple(lines),
        cumulative_evidence=grown,
        residual_over_variable=seen,
    )


def _rejected(diagnosis: Findings, each: Rejected) -> str:
    return f"{title_of(each.effect, diagnosis)}: {each.reason}."


def _could_hide(diagnosis: Findings) -> list[str]:
    """Limits of detection in one sentence."""
    sizes = detectable(diagnosis.base, [each.effect for each in diagnosis.rejected])
    texts = [f"{title_of(name, diagnosis)} {e.value:.2g} {e.unit}".removesuffix(" -") for name, e in sizes.items()]
    if not texts:
        return []
    return [
        f"Smaller effects may be hidden. Sizes that this log shows with a probability of 50 %: {joined_words(texts)}. "
        "Effects of half that size are almost never detected."
    ]
