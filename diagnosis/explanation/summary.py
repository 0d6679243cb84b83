"""A diagnosis in a few plain sentences, for the terminal and for the head of the report."""

from __future__ import annotations

from diagnosis.explanation.paragraphs import Explanation
from diagnosis.explanation.wording import (
    change,
    joined_words,
    measured,
    percent,
    sentence_case,
    size,
    title_of,
    torque_or_force,
)
from diagnosis.holdout import gain_errors
from diagnosis.model_probability import CLEAR
from diagnosis.repeated_runs import repeated_pairs
from diagnosis.result import Cause, Findings


def headline(diagnosis: Findings) -> str:
    """The verdict in one sentence."""
    causes = diagnosis.causes
    if diagnosis.verdict == "nothing_missing":
        if diagnosis.extended.bandwidth > 0.0 and not repeated_pairs(diagnosis.extended.log):
            return (
                "No effect of the catalogue is missing, but a random disturbance acts on the load. Record the same run "
                "twice: what repeats is no random disturbance."
            )
        return "No effect is missing: noise accounts for the remaining error."
    if diagnosis.verdict == "unknown" or not causes:
        where = ", ".join(diagnosis.unexplained.depends_on)
        lives = f"; it depends on {where}" if where else ""
        return f"The model has an error that no effect of the catalogue explains{lives}."
    if len(causes) == 1 and causes[0].missing < CLEAR:
        names = " or ".join(map(title_of, _likeliest_first(causes[0], _close(causes[0]))))
        if diagnosis.unknown.likelier_than(causes[0].probability):
            return f"The model probably lacks {names}; what no effect explains is about as large."
        return (
            f"The model probably lacks {names}. The probability that any effect is missing is "
            f"{percent(causes[0].missing)}."
        )
    named = [title_of(cause.effect) for cause in causes if cause.probability >= CLEAR]
    open_ones = [" or ".join(map(title_of, _likeliest_first(c, _rivals(c)))) for c in causes if c.probability < CLEAR]
    known = f"The model lacks {joined_words(named)}" if named else ""
    unclear = f"lacks {joined_words(open_ones)}; this log does not tell which" if open_ones else ""
    if known and unclear:
        return f"{known}. It also {unclear}."
    return f"{known}." if known else f"The model {unclear}."


def sentences(diagnosis: Findings, explanation: Explanation | None = None) -> list[str]:
    """What stands below the headline: causes with odds and sizes, their margins if explained, the gain, the rest."""
    lines = [*map(_cause, diagnosis.causes), *_minor(diagnosis)]
    lines += explanation.short if explanation is not None else ()
    gain = diagnosis.gain
    if gain is not None:
        runs = "the validation run" if len(gain.runs) == 1 else f"{len(gain.runs)} validation runs"
        error = gain_errors(diagnosis)
        before = measured(gain.held_out_rms_before, error.before, gain.unit)
        after = measured(gain.held_out_rms_after, error.after, gain.unit)
        floor = f"the {gain.floor_name} is {measured(gain.noise_floor, error.noise_floor, gain.unit)}"
        what = f"On {runs} the simulation error"
        if diagnosis.extended is diagnosis.base:
            lines.append(f"{what} is {before} rms; {floor}.")
        else:
            went = "falls" if gain.cut >= 0.0 else "rises"
            lines.append(f"{what} {went} from {before} to {after} rms ({change(gain.cut, error.cut)}); {floor}.")
    else:
        lines.append("There is no validation data, so the gain is not proven.")
    inverse = diagnosis.torque_error
    shares = {name: percent(getattr(inverse, name), std) for name, std in inverse.std.items()}
    lines.append(
        f"Relative {torque_or_force(diagnosis.residual_before.unit)} error of the inverse model "
        f"(below {inverse.cutoff:.3g} Hz): "
        f"{shares['estimation_before']} -> {shares['estimation_after']} on the estimation data, "
        f"{shares['held_out_before']} -> {shares['held_out_after']} on validation data."
    )
    share = diagnosis.unexplained.share
    if diagnosis.verdict != "nothing_missing" and share >= 0.005:
        where = ", ".join(diagnosis.unexplained.depends_on)
        std = None if gain is None else gain_errors(diagnosis).share
        over = f"; it depends on {where}" if where else ""
        lines.append(f"{percent(share, std)} of the error power remains unexplained{over}.")
    return lines


def _cause(cause: Cause) -> str:
    sizes = size(cause.parameters.items())
    rivals = ", ".join(f"{title_of(name)} {percent(p)}" for name, p in cause.alternatives[:2])
    return (
        f"{sentence_case(title_of(cause.effect))}: probability {percent(cause.probability)}"
        f"{f', {sizes}' if sizes else ''}{f'; alternatives: {rivals}' if rivals else ''}."
    )


def _minor(diagnosis: Findings) -> list[str]:
    """What is probable but small, in one sentence."""
    unit = diagnosis.residual_before.unit
    told = [
        f"{title_of(each.effect, diagnosis)}{f' ({measured(each.rms, None, unit)} rms)' if each.rms else ''}"
        for each in diagnosis.minor
    ]
    if not told:
        return []
    return [f"Minor: {joined_words(told)}, no larger than what no effect explains; it may be a part of that."]


def _likeliest_first(cause: Cause, rivals: list[str]) -> list[str]:
    """It and some of its alternatives."""
    known = dict(cause.alternatives) | {cause.effect: cause.probability}
    return sorted((cause.effect, *rivals), key=lambda name: -known[name])


def _rivals(cause: Cause) -> list[str]:
    """The alternatives that cannot be put aside."""
    return _close(cause) or [name for name, _ in cause.alternatives[:1]]


def _close(cause: Cause) -> list[str]:
    return [name for name, p in cause.alternatives if p > 0.05]
