"""The posterior over sets of effects as a person reads it: what is sure, what is either-or, what no effect explains."""

from __future__ import annotations

from diagnosis.explanation.wording import joined_words, measured, percent, title_of, torque_or_force
from diagnosis.levels import SURE
from diagnosis.result import EffectSet, Findings
from plant.effects.nonparametric import unnamed

NOTHING = "nothing more"
"""What a set without effects is called."""
_SAID = 0.05  # probability from which an alternative is said in a sentence
_MOST = 4  # alternatives in a sentence


def posterior_sentences(diagnosis: Findings) -> tuple[str, ...]:
    """Each thought in a sentence."""
    sure = [title_of(name, diagnosis) for name in sorted(_settled(diagnosis))]
    return (*([f"Probability above 90 %: {joined_words(sure)}."] if sure else []), *open_sentences(diagnosis))


def open_sentences(diagnosis: Findings) -> tuple[str, ...]:
    """Of what is not sure."""
    lines = _either_or(diagnosis, _settled(diagnosis) | {each.effect for each in diagnosis.minor})
    lines += _minor(diagnosis)
    if diagnosis.unknown.depends_on:
        lines.append(
            f"Unexplained: {unexplained(diagnosis)}; it depends on {joined_words(diagnosis.unknown.depends_on)}."
        )
    return tuple(lines)


def unexplained(diagnosis: Findings) -> str:
    """What no effect explains: an error of the measurement where a torque is not likely, else how much torque."""
    unknown = diagnosis.unknown
    if unknown.probability <= SURE < unknown.measurement_error:
        return "an error of the measurement"
    return f"about {percent(unknown.share)} of the {torque_or_force(diagnosis.residual_before.unit)} in the log"


def set_title(each: EffectSet, diagnosis: Findings, besides: set[str] | frozenset[str] = frozenset()) -> str:
    """The effects of a set, but for some, and what stands in the place of one, as people write them."""
    instead = [f"something over {joined_words(each.unknown)}"] if each.unknown and each.fit is None else []
    if each.fit is not None:
        instead = [effect.title for effect in each.fit.model.effects if effect.name in unnamed]
    titles = [title_of(name, diagnosis) for name in each.effects if name not in besides]
    return joined_words([*titles, *instead]) or NOTHING


def _settled(diagnosis: Findings) -> set[str]:
    return {cause.effect for cause in diagnosis.causes if cause.probability > SURE}


def _either_or(diagnosis: Findings, settled: set[str]) -> list[str]:
    """The alternatives among what is neither sure nor small."""
    shares: dict[str, float] = {}
    for each in diagnosis.sets:
        title = set_title(each, diagnosis, settled)
        shares[title] = shares.get(title, 0.0) + each.probability
    told = sorted((item for item in shares.items() if item[1] >= _SAID), key=lambda item: -item[1])[:_MOST]
    if len(told) < 2 or told[0][0] == NOTHING:
        return []
    return [f"Alternatives: {joined_words([f'{title} ({percent(share)})' for title, share in told], 'or')}."]


def _minor(diagnosis: Findings) -> list[str]:
    """What is probable but small, in one sentence."""
    unit = diagnosis.residual_before.unit
    told = [
        f"{title_of(each.effect, diagnosis)}{f' ({measured(each.rms, None, unit)} rms)' if each.rms else ''}"
        for each in diagnosis.minor
    ]
    if not told:
        return []
    acts = torque_or_force(unit)
    return [f"Minor: {joined_words(told)}, no larger than the unexplained {acts}; it may be a part of that."]
