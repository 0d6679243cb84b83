"""The posterior over sets of effects in sentences: certain effects, alternatives, and the unexplained part."""

from __future__ import annotations

from diagnosis.explanation.wording import joined_words, measured, percent, size, title_of, torque_or_force
from diagnosis.levels import SURE
from diagnosis.result import EffectSet, Findings
from plant.effects.nonparametric import unnamed

NOTHING = "nothing more"
"""Name of a set without effects."""
_LEAST_PROBABILITY = 0.05  # least probability of an alternative in a sentence
_NEARLY_ALL = 0.9995  # share that is not written as a number
_MOST = 4  # largest number of alternatives in a sentence


def posterior_sentences(diagnosis: Findings) -> tuple[str, ...]:
    """Sentences on the certain effects, then on all others."""
    settled = [title_of(name, diagnosis) for name in sorted(_settled(diagnosis))]
    return (*([f"Probability above 90 %: {joined_words(settled)}."] if settled else []), *open_sentences(diagnosis))


def open_sentences(diagnosis: Findings) -> tuple[str, ...]:
    """Sentences on the alternatives, the minor effects and the unexplained part."""
    lines = _either_or(diagnosis, _settled(diagnosis) | {each.effect for each in diagnosis.minor})
    lines += _minor(diagnosis)
    if diagnosis.unknown.depends_on:
        lines.append(
            f"Unexplained: {unexplained(diagnosis)}; it depends on {joined_words(diagnosis.unknown.depends_on)}."
        )
    return tuple(lines)


def unexplained(diagnosis: Findings) -> str:
    """The unexplained part: a measurement error if only that is certain, else the share of the torque."""
    unknown = diagnosis.unknown
    if unknown.probability <= SURE < unknown.measurement_error:
        return "an error of the measurement"
    part = "nearly all" if unknown.share >= _NEARLY_ALL else f"about {percent(unknown.share)}"
    return f"{part} of the {torque_or_force(diagnosis.residual_before.unit)} in the log"


def set_title(each: EffectSet, diagnosis: Findings, besides: set[str] | frozenset[str] = frozenset()) -> str:
    """Titles of the effects of a set, except `besides`, and of its non-parametric effects, joined."""
    instead = [f"something over {joined_words(each.unknown)}"] if each.unknown and each.fit is None else []
    if each.fit is not None:
        instead = [effect.title for effect in each.fit.model.effects if effect.name in unnamed]
    titles = [title_of(name, diagnosis) for name in each.effects if name not in besides]
    return joined_words([*titles, *instead]) or NOTHING


def _settled(diagnosis: Findings) -> set[str]:
    return {cause.effect for cause in diagnosis.causes if cause.probability > SURE}


def _either_or(diagnosis: Findings, settled: set[str]) -> list[str]:
    """The alternatives among the effects that are neither certain nor minor."""
    shares: dict[str, float] = {}
    for each in diagnosis.sets:
        title = set_title(each, diagnosis, settled)
        shares[title] = shares.get(title, 0.0) + each.probability
    likeliest = sorted((item for item in shares.items() if item[1] >= _LEAST_PROBABILITY), key=lambda item: -item[1])[
        :_MOST
    ]
    if len(likeliest) < 2 or likeliest[0][0] == NOTHING:
        return []
    return [f"Alternatives: {joined_words([f'{title} ({percent(share)})' for title, share in likeliest], 'or')}."]


def _minor(diagnosis: Findings) -> list[str]:
    """The minor effects, in one sentence."""
    unit = diagnosis.residual_before.unit
    items = []
    for each in diagnosis.minor:
        torque = [f"{measured(each.rms, None, unit)} rms"] if each.rms else []
        sizes = "; ".join(filter(None, (size(each.parameters.items()), *torque)))
        items.append(f"{title_of(each.effect, diagnosis)}{f' ({sizes})' if sizes else ''}")
    if not items:
        return []
    acts = torque_or_force(unit)
    return [f"Minor: {joined_words(items)}, no larger than the unexplained {acts}; it may be a part of that."]
