"""The verdict on each effect, from the posterior over sets of effects.

An effect that is probable and larger than the discrepancy (`Posterior.probability`) is a cause. One that is probable by
the evidence alone (`Posterior.of`), but smaller, is a minor effect.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.evidence.discrepancy import Discrepancy
from diagnosis.evidence.posterior import Posterior, special_cases
from diagnosis.levels import LIKELY, SURE
from diagnosis.residual_torque import ResidualTorque, effects_over
from diagnosis.result import LISTED, Verdict
from plant.effects import catalogue
from plant.effects.nonparametric import unnamed

_NEAR_LARGEST = 0.8  # share of the largest gain by one variable, from which another variable is reported too
_CONSTANT = "nothing"  # variable of a constant torque


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """Verdict and effects that follow from a posterior.

    Attributes:
        verdict: "named", "nothing_missing", "ambiguous" or "unknown".
        causes: probability of each cause.
        minor: probability of each minor effect.
        depends_on: variables of the unmodelled torque; empty if it is negligible.
    """

    verdict: Verdict
    causes: Mapping[str, float]
    minor: Mapping[str, float]
    depends_on: tuple[str, ...]


def judged(
    posterior: Posterior, missing: ResidualTorque, *, shows: bool, ruled_out: frozenset[str] | None
) -> Judgement:
    """The verdict of a posterior: which effects are probable follows from it, how sure they are from the tempered one.

    Args:
        posterior: over the sets.
        missing: residual torque of the leading set.
        shows: whether there is other evidence of an unmodelled torque: a curve improves the prediction of a part of the
            log that it was not fitted to, or repeated runs have the same error.
        ruled_out: effects of a set that was ruled out, but is clearly more probable than all others. Then the verdict
            is not "nothing_missing", and an effect that is neither one of these nor a special case of one is no cause.
    """
    beside = posterior.best.discrepancy.posterior
    probable = [name for name, p in posterior.names().items() if p > LIKELY]
    fitted = frozenset[str]().union(*(each.names for each in posterior.sets))
    tempered = posterior.tempered
    probabilities = {name: posterior.probability(name) for name in posterior.names() if name in fitted}
    to_report = {name: tempered.probability(name) for name in probabilities}
    among = None if ruled_out is None else frozenset[str]().union(*map(special_cases, ruled_out))
    likely = [name for name, p in probabilities.items() if max(p, to_report[name]) > LIKELY]
    causes = {name: to_report[name] for name in likely if among is None or name in among}
    if causes and among is None:
        causes |= {name: to_report[name] for name in posterior.leading if name in probabilities}
    instead = posterior.nonparametric() > LIKELY
    left = beside.something > SURE or missing.excess > 1.0 - SURE or shows or instead
    small = [name for name in probable if name not in likely]  # the others replace a ruled-out effect
    minor = {name: to_report[name] for name in small if not special_cases(name) & causes.keys()}
    more = left or bool(minor) or ruled_out is not None
    doubtful = any(is_uncertain(probabilities[name]) for name in minor)
    doubtful = doubtful or posterior.complete({*causes, *minor}) <= LIKELY
    verdict = _verdict(posterior, causes, more=more, uncertain=doubtful)
    if verdict == "ambiguous" and not causes:
        causes = _leading(tempered)
    return Judgement(
        verdict=verdict,
        causes=dict(sorted(causes.items(), key=lambda item: -item[1])),
        minor={name: p for name, p in minor.items() if name not in causes},
        depends_on=variables(posterior, missing, ruled_out or frozenset()) if left else (),
    )


def doubted(judgement: Judgement) -> Judgement:
    """The judgement with no effect sure, as the validation data contradict the model."""
    causes = {name: min(p, SURE) for name, p in judgement.causes.items()}
    return replace(judgement, causes=causes, verdict="ambiguous" if judgement.verdict == "named" else judgement.verdict)


def variables(posterior: Posterior, missing: ResidualTorque, ruled_out: frozenset[str]) -> tuple[str, ...]:
    """Variables of the unexplained part: of non-parametric effects in the set, else of the discrepancy.

    A non-parametric effect that was ruled out is still the best indication of the variable. Without a discrepancy the
    variables follow from the residual torque.
    """
    best = posterior.best
    found = variables_instead(best.names) or variables_instead(ruled_out) or _carrying(best.discrepancy)
    found = found or tuple(curve.variable for curve in missing.curves if curve.share > 1.0 - SURE)
    each = dict.fromkeys(variable for several in found for variable in several.split(" and "))
    return tuple(effects_over(variable, best.fit.log.axis) for variable in each if variable != _CONSTANT)


def variables_instead(names: frozenset[str]) -> tuple[str, ...]:
    """Variables of the non-parametric effects of a set."""
    return tuple(variable for name in sorted(names.intersection(unnamed)) for variable in unnamed[name].variables)


def _carrying(discrepancy: Discrepancy) -> tuple[str, ...]:
    """The variable that explains most of a discrepancy, others with nearly the same gain, and further ones needed."""
    alone = discrepancy.explained_by()
    if not alone:
        return ()
    ranked = sorted(alone, key=lambda variable: -alone[variable])
    needed = ranked[:1]
    while more := discrepancy.explained_by(beside=needed):
        further = max(more, key=lambda variable: more[variable])
        if more[further] < 1.0 - SURE:
            break
        needed.append(further)
    nearly_as_good = (variable for variable in ranked if alone[variable] >= _NEAR_LARGEST * alone[ranked[0]])
    return tuple(dict.fromkeys((*nearly_as_good, *needed)))


def alternatives(posterior: Posterior, name: str) -> tuple[tuple[str, float], ...]:
    """Competing effects of the sets without an effect, with the probability of those sets.

    An effect competes if it is more probable without the given effect than with it. Effects of the best set and
    non-parametric effects are left out.
    """
    beside: dict[str, float] = {}
    instead: dict[str, float] = {}
    for names, p in posterior.reported.items():
        found = beside if name in names else instead
        for other in names.difference(posterior.best.names, unnamed):
            found[other] = found.get(other, 0.0) + p
    probability = posterior.probability(name)
    competing = {n: p for n, p in instead.items() if p * probability > beside.get(n, 0.0) * (1.0 - probability)}
    return tuple(sorted(((n, p) for n, p in competing.items() if p >= LISTED), key=lambda item: -item[1]))


def log_bayes(posterior: Posterior, name: str) -> float:
    """Log marginal likelihood of the best set with an effect, or a wider form of it, less that of the best without."""
    best = {True: -np.inf, False: -np.inf}
    for each in posterior.sets:
        holds = any(name in special_cases(other) for other in each.names)
        best[holds] = max(best[holds], each.log_marginal)
    return float(best[True] - best[False])


def of_the_measurement(name: str) -> bool:
    """Whether an effect belongs to the torque measurement and not to the machine."""
    return name in catalogue and bool(catalogue[name].measured)


def is_uncertain(probability: float) -> bool:
    """Whether a probability is neither low nor high: between 0.1 and 0.9."""
    return 1.0 - SURE < probability <= SURE


def _verdict(posterior: Posterior, causes: Mapping[str, float], *, more: bool, uncertain: bool) -> Verdict:
    if posterior.nonparametric() > SURE:
        return "unknown"
    of_the_machine = [name for name in causes if not of_the_measurement(name)]
    if causes and (of_the_machine or not more):
        return "named" if all(p > SURE for p in causes.values()) and not uncertain else "ambiguous"
    if more:
        return "unknown"
    nothing = posterior.reported.get(frozenset(), 0.0)
    return "nothing_missing" if nothing > LIKELY or not posterior.names() else "ambiguous"


def _leading(posterior: Posterior) -> dict[str, float]:
    """The effect with the highest probability."""
    probabilities = {
        name: posterior.probability(name) for each in posterior.sets for name in each.names.difference(unnamed)
    }
    best = max(probabilities, key=lambda name: probabilities[name])
    return {best: probabilities[best]}
