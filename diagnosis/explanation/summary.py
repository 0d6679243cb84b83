"""A diagnosis in a few sentences, for the terminal and the first part of the report."""

from __future__ import annotations

from dataclasses import replace

from diagnosis.evidence.posterior import special_cases
from diagnosis.explanation.paragraphs import Explanation
from diagnosis.explanation.posterior_sentences import open_sentences
from diagnosis.explanation.wording import (
    change,
    joined_words,
    measured,
    percent,
    predicted,
    sentence_case,
    size,
    strength,
    title_of,
    torque_or_force,
)
from diagnosis.holdout import gain_errors
from diagnosis.levels import SURE
from diagnosis.repeated_runs import repeated_pairs
from diagnosis.result import Cause, Findings
from diagnosis.verdict import is_uncertain, of_the_measurement
from plant.effects.nonparametric import unnamed

_LATE = "The torque of this log was measured, and its measurement is late."


def headline(diagnosis: Findings) -> str:
    """The verdict in one sentence, after another one if the torque of the log was measured with a lag."""
    late = {cause.effect for cause in diagnosis.causes if cause.probability > SURE and of_the_measurement(cause.effect)}
    if late:
        others = replace(diagnosis, causes=tuple(cause for cause in diagnosis.causes if cause.effect not in late))
        nothing = diagnosis.verdict == "named" and not others.causes
        return f"{_LATE} {'No other effect is missing.' if nothing else headline(others)}"
    causes = diagnosis.causes
    if diagnosis.verdict == "nothing_missing":
        if diagnosis.extended.bandwidth > 0.0 and not repeated_pairs(diagnosis.extended.log):
            return (
                "No effect of the catalogue is missing, but a random disturbance acts on the load. Record the same run "
                "twice: what repeats is no random disturbance."
            )
        return "No effect is missing: noise accounts for the remaining error."
    if not causes:
        return f"The model has an error that no effect of the catalogue explains{_where(diagnosis)}."
    if diagnosis.verdict == "unknown":
        return f"{_of_causes(diagnosis)} More of its error is explained by no effect{_where(diagnosis)}."
    return _of_causes(diagnosis)


def _where(diagnosis: Findings) -> str:
    """Where the unexplained error occurs: in the validation data only, or over which variables."""
    if diagnosis.only_in_validation is not None:
        return "; it shows in the validation data alone"
    depends_on = ", ".join(diagnosis.unexplained.depends_on)
    return f"; it depends on {depends_on}" if depends_on else ""


def _of_causes(diagnosis: Findings) -> str:
    """The effects that the model lacks with certainty or probably."""
    causes = diagnosis.causes
    forms = {cause.effect: _forms(cause) for cause in causes}
    named = [title_of(forms[c.effect][0] or c.effect) for c in causes if c.probability > SURE or forms[c.effect][0]]
    whether = "".join(
        f"; this log does not show whether {'it' if len(named) == 1 else f'the {title_of(kind)}'} is "
        f"{joined_words([title_of(name) for name in wider], 'or')}"
        for kind, wider in forms.values()
        if kind is not None
    )
    uncertain = [cause for cause in causes if cause.probability <= SURE and forms[cause.effect][0] is None]
    open_ones = list(dict.fromkeys(title_of(name) for cause in uncertain for name in _likeliest_first(cause)))
    torn = any(_close(cause) for cause in uncertain)
    known = f"The model lacks {joined_words(named)}" if named else ""
    acts = torque_or_force(diagnosis.residual_before.unit)
    large = (
        "the validation data contradict the model"
        if diagnosis.contradicted
        else f"the unexplained {acts} is about as large"
    )
    which = "; this log does not show which" if torn else f"; {large}"
    unclear = f"probably lacks {joined_words(open_ones, 'or')}{which}" if open_ones else ""
    if known and unclear:
        return f"{known}{whether}. It also {unclear}."
    if diagnosis.verdict == "ambiguous" and not unclear and not whether:
        return f"{known}. It may also lack {_uncertain(diagnosis, acts)}."
    return f"{known}{whether}." if known else f"The model {unclear}."


def _forms(cause: Cause) -> tuple[str | None, list[str]]:
    """The simplest form of a cause and the wider ones, if it is sure that one of them acts; else None and none."""
    options = _likeliest_first(cause)
    kinds = set(options).intersection(*map(special_cases, options))
    together = cause.probability + sum(p for name, p in cause.alternatives if name in options)
    if cause.probability > SURE or len(options) < 2 or len(kinds) != 1 or together <= SURE:
        return None, []
    (kind,) = kinds
    return kind, [name for name in options if name != kind]


def _uncertain(diagnosis: Findings, acts: str) -> str:
    """Further effects that may be missing: uncertain minor ones, else those that the log does not identify."""
    small = [each.effect for each in diagnosis.minor if is_uncertain(each.probability)]
    if small:
        return f"{joined_words([title_of(name) for name in small])}; the unexplained {acts} is about as large"
    causes = {cause.effect for cause in diagnosis.causes}
    others = {name for each in diagnosis.sets for name in each.effects if not special_cases(name) & causes}
    probabilities = {name: sum(each.probability for each in diagnosis.sets if name in each.effects) for name in others}
    ranked = sorted(probabilities, key=lambda name: (-probabilities[name], name))
    open_ones = [
        name for name in ranked if is_uncertain(probabilities[name])
    ] or ranked  # one of many improbable ones may act
    listed = [f"{title_of(name)} (probability {percent(probabilities[name])})" for name in open_ones]
    return f"{joined_words(listed) or 'something else'}; this log does not show whether it does"


def sentences(diagnosis: Findings, explanation: Explanation | None = None) -> list[str]:
    """The sentences after the headline: causes with probabilities and sizes, the gain, and the remaining error.

    Args:
        diagnosis: to be summarised.
        explanation: of this diagnosis, for the reason if no effect is reported.
    """
    lines = [_cause(diagnosis, cause) for cause in diagnosis.causes]
    if explanation is not None and not diagnosis.causes:
        lines.append(explanation.reasons[0].sentences[0])
    lines += open_sentences(diagnosis)
    if described := _described(diagnosis):
        lines.append(f"The extended model has {described}, with which it predicts better; they need not be the causes.")
    gain = diagnosis.gain
    if gain is not None:
        runs = "the validation run" if len(gain.runs) == 1 else f"{len(gain.runs)} validation runs"
        error = gain_errors(diagnosis)
        before = measured(gain.held_out_rms_before, error.before, gain.unit)
        after = measured(gain.held_out_rms_after, error.after, gain.unit)
        floor = f"the {gain.floor_name} is {measured(gain.noise_floor, error.noise_floor, gain.unit)}"
        what = f"On {runs} the {predicted(diagnosis)} error"
        if diagnosis.extended is diagnosis.base:
            lines.append(f"{what} is {before} rms; {floor}.")
        else:
            went = "falls" if gain.cut >= 0.0 else "rises"
            lines.append(f"{what} {went} from {before} to {after} rms ({change(gain.cut, error.cut)}); {floor}.")
    else:
        lines.append("There is no validation data, so the gain is not proven.")
    inverse = diagnosis.torque_error
    shares = {name: percent(getattr(inverse, name), std) for name, std in inverse.std.items()}
    extended = diagnosis.extended is not diagnosis.base
    estimation, validation = (
        f"{shares[f'{data}_before']} -> {shares[f'{data}_after']}" if extended else shares[f"{data}_before"]
        for data in ("estimation", "held_out")
    )
    lines.append(
        f"Relative {torque_or_force(diagnosis.residual_before.unit)} error of the inverse model "
        f"(below {inverse.cutoff:.3g} Hz): {estimation} on the estimation data, {validation} on validation data."
    )
    share = diagnosis.unexplained.share
    if diagnosis.verdict != "nothing_missing" and share >= 0.005:
        where = ", ".join(diagnosis.unexplained.depends_on)
        std = None if gain is None else gain_errors(diagnosis).share
        over = f"; it depends on {where}" if where else ""
        lines.append(f"{percent(share, std)} of the error power remains unexplained{over}.")
    return lines


def _described(diagnosis: Findings) -> str:
    """Effects of the extended model where none is named; empty if there are none."""
    base = {effect.name for effect in diagnosis.base.model.effects}
    added = [effect.name for effect in diagnosis.extended.model.effects if effect.name not in base | unnamed.keys()]
    return "" if diagnosis.without else joined_words([title_of(name, diagnosis) for name in added])


def _cause(diagnosis: Findings, cause: Cause) -> str:
    """Probability, evidence, parameters and torque of a cause."""
    sizes = size(cause.parameters.items())
    torque = measured(cause.rms, None, diagnosis.residual_before.unit)
    return (
        f"{sentence_case(title_of(cause.effect, diagnosis))}: probability {percent(cause.probability)}, evidence "
        f"{strength(cause.log_bayes)}{f'; {sizes}' if sizes else ''}; {torque} rms."
    )


def _likeliest_first(cause: Cause) -> list[str]:
    """A cause and its alternatives with a probability above 0.05, the most probable first."""
    known = dict(cause.alternatives) | {cause.effect: cause.probability}
    return sorted((cause.effect, *_close(cause)), key=lambda name: -known[name])


def _close(cause: Cause) -> list[str]:
    return [name for name, p in cause.alternatives if p > 0.05]
