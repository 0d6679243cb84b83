"""Why a candidate effect is not reported: the most important reason."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from diagnosis.evidence.marginal import Explanation
from diagnosis.evidence.posterior import Posterior, special_cases
from diagnosis.explanation.wording import joined_words, percent, title_of
from diagnosis.levels import LIKELY
from diagnosis.result import Rejected
from identification.fit_result import Fit
from plant.effects import Effect

_EQUAL = float(np.log(10.0))  # log Bayes factor below which two sets explain a log equally well


def rejected(
    base: Fit,
    posterior: Posterior,
    effects: Mapping[str, type[Effect]],
    named: Collection[str],
    falsified: Mapping[str, str],
) -> tuple[Rejected, ...]:
    """One sentence for each candidate that is not reported, the most probable first.

    Args:
        base: fit of the base model.
        posterior: over the sets.
        effects: all candidates, by name.
        named: effects that are reported as a cause or a minor effect.
        falsified: for each effect that is ruled out, the reason.
    """
    candidates = sorted((name for name in effects if name not in named), key=lambda name: -posterior.of(name))
    return tuple(
        Rejected(effect=name, reason=_no_more(name, named) or _reason(base, posterior, effects[name], falsified))
        for name in candidates
    )


def _no_more(name: str, named: Collection[str]) -> str | None:
    """Why a wider form of a reported effect is not reported; None if it is no wider form."""
    special = [title_of(each) for each in special_cases(name) if each in named]
    return f"it explains no more than {joined_words(special)}" if special else None


def _reason(base: Fit, posterior: Posterior, kind: type[Effect], falsified: Mapping[str, str]) -> str:
    holder = next((each for each in posterior.sets if kind.name in each.names), None)
    if holder is not None:
        return _behind(posterior, holder, kind.name)
    if kind.name in falsified:
        return falsified[kind.name]
    if base.model.holds(kind.name):
        return "the base model has it"
    if not base.log.shows(kind):
        return "this log cannot show it"
    return "its linearised evidence was too small for a full fit"


def _behind(posterior: Posterior, holder: Explanation, name: str) -> str:
    """Why the best set with an effect is not the reported one."""
    less = next((each for each in posterior.sets if each.names == holder.names - {name}), None)
    log_bayes_factor = holder.log_marginal - (posterior.best if less is None else less).log_marginal
    if log_bayes_factor < 0.0:
        return f"it costs more than it explains (log Bayes factor {log_bayes_factor:.1f})"
    behind = posterior.best.log_marginal - holder.log_marginal
    others = joined_words([title_of(other) for other in sorted(posterior.best.names - holder.names)])
    if posterior.probability(name) > LIKELY:
        return "it only takes the place of an effect that is ruled out"
    if not others:
        return f"its probability is {percent(posterior.of(name))}"
    if behind < _EQUAL:
        return f"{others} explains as much; its probability is {percent(posterior.of(name))}"
    return f"{others} explains more (log Bayes factor {behind:.1f})"
