"""Format of the numbers and names of a diagnosis in sentences."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np

from diagnosis.result import Estimate, Findings
from plant.effects import Effect, catalogue
from plant.effects.nonparametric import unnamed
from plant.effects.parameter import Axis
from plant.uncertain_number import measured as measured


def percent(share: float, std: float | None = None) -> str:
    """A probability or share in per cent, with its standard error if it has one; never rounded to 0 or 100 %.

    A ratio from ten on is written as a factor; a value that is not finite is "not measured".
    """
    if not np.isfinite(share):
        return "not measured"
    if share >= 10.0:
        return f"{share:.2g} times"
    if 0.9995 <= share < 1.0005:
        return "> 99.9 %"
    if share < 0.0005:
        return "< 0.1 %"
    return f"{100.0 * share:.3g} %" if std is None else measured(100.0 * share, 100.0 * std, "%")


def change(cut: float, std: float | None = None) -> str:
    """Size of a relative reduction or increase of an error; an error at least doubled is written as a factor."""
    return f"{1.0 - cut:.2g} times" if cut <= -1.0 else percent(abs(cut), std)


def strength(log_bayes: float) -> str:
    """Grade of the evidence (Kass and Raftery 1995) with its number: decisive (log Bayes factor 48.3)."""
    if np.isinf(log_bayes):
        return "decisive (no set without it is tenable)" if log_bayes > 0.0 else "against it"
    grades = ((5.0, "decisive"), (3.0, "strong"), (1.0, "positive"), (-1.0, "weak"), (-np.inf, "against it"))
    grade = next(word for least, word in grades if log_bayes >= least)
    return f"{grade} (log Bayes factor {rise(log_bayes)})"


def rise(log_likelihood: float) -> str:
    """A gain in log-likelihood: three digits, an integer from 1000 on, never a power of ten."""
    return f"{log_likelihood:.3g}" if abs(log_likelihood) < 1000.0 else f"{log_likelihood:.0f}"


def size(parameters: Iterable[tuple[str, Estimate]]) -> str:
    """Parameters with their standard errors and units."""
    return ", ".join(
        f"{name.replace('_', ' ')} {measured(e.value, e.std, e.unit)}".rstrip(" -") for name, e in parameters
    )


def torque_or_force(unit: str) -> str:
    """The word "torque" or "force" for a unit of the command; "command" for any other unit."""
    return {"N m": "torque", "N": "force"}.get(unit, "command")


def on_axis(text: str, axis: Axis) -> str:
    """A text on a rotary axis in the words of a linear one, if the axis is linear."""
    words = {"periods per turn": "phase per metre", "angle": "position", "torque": "force"}
    for rotary, linear in words.items() if axis == "linear" else ():
        text = re.sub(rf"\b{rotary}\b", linear, text)
    return text


def predicted(diagnosis: Findings) -> str:
    """What the error on validation data is of: a simulation, or the torque of an inverse model."""
    log = diagnosis.base.log
    return torque_or_force(log.command_unit) if log.response == "torque" else "simulation"


def sentence_case(text: str) -> str:
    """The text with a capital first letter, otherwise unchanged."""
    return text[:1].upper() + text[1:]


def joined_words(names: Sequence[str], last: str = "and") -> str:
    """A, B and C."""
    return f" {last} ".join(filter(None, (", ".join(names[:-1]), names[-1]))) if names else ""


def effect_of(diagnosis: Findings, name: str) -> type[Effect] | None:
    """The class of an effect, from the catalogue or, for a custom effect, from the extended model."""
    own = diagnosis.model.effect(name)
    return catalogue.get(name) or (None if own is None else type(own))


def title_of(name: str, diagnosis: Findings | None = None) -> str:
    """The effect's title, for use in sentences."""
    kind = unnamed.get(name) or (catalogue.get(name) if diagnosis is None else effect_of(diagnosis, name))
    return name.replace("_", " ") if kind is None else kind.title
