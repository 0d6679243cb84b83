"""The verdict: what may be said of each name, given the posterior over sets of effects.

A name that is probable and larger than the discrepancy (`Posterior.probability`) is a cause. One that is probable by
the evidence alone (`Posterior.of`), but smaller, is a minor effect, on which no verdict rests.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from diagnosis.evidence.discrepancy import Discrepancy
from diagnosis.evidence.posterior import Posterior, special_cases
from diagnosis.levels import LIKELY, SURE
from diagnosis.residual_torque import ResidualTorque, effects_over
from diagnosis.result import LISTED, Verdict
from plant.effects import catalogue
from plant.effects.nonparametric import unnamed

_CARRIES = 0.8  # of what the most telling variable explains, from which another is told too
_CONSTANT = "nothing"  # what a constant torque depends on


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """What a posterior says.

    Attributes:
        verdict: "named", "nothing_missing", "ambiguous" or "unknown".
        causes: probability of each cause.
        minor: probability of each minor effect.
        depends_on: variables of the unmodelled torque; empty where there is none to speak of.
    """

    verdict: Verdict
    causes: Mapping[str, float]
    minor: Mapping[str, float]
    depends_on: tuple[str, ...]


def judged(
    posterior: Posterior, missing: ResidualTorque, *, shows: bool, ruled_out: frozenset[str] | None
) -> Judgement:
    """The verdict of a posterior.

    Args:
        posterior: over the sets.
        missing: residual torque of the likeliest set; an observer has to follow it.
        shows: whether more than its evidence shows an unmodelled torque: a curve predicts a part of the log that it was
            not fitted to better, or runs that repeat one another leave the same.
        ruled_out: names of a set that was ruled out, but is clearly likelier than all others. Then nothing missing is
            no answer, and a name that is neither among them nor a special case of one only takes its place.
    """
    beside = posterior.best.discrepancy.posterior
    probable = {name: p for name, p in posterior.names().items() if p > LIKELY}
    fitted = frozenset[str]().union(*(each.names for each in posterior.sets))
    told = {name: posterior.probability(name) for name in posterior.names() if name in fitted}
    among = None if ruled_out is None else frozenset[str]().union(*map(special_cases, ruled_out))
    causes = {name: p for name, p in told.items() if p > LIKELY and (among is None or name in among)}
    if causes and among is None:
        causes |= {name: told[name] for name in posterior.leading if name in told}
    instead = posterior.nameless() > LIKELY
    left = beside.something > SURE or missing.excess > 1.0 - SURE or shows or instead
    small = {name: told[name] for name in probable if told[name] <= LIKELY}  # the others take a ruled-out one's place
    minor = {name: p for name, p in small.items() if not special_cases(name) & causes.keys()}
    more = left or bool(minor) or ruled_out is not None
    doubtful = any(map(in_doubt, minor.values())) or posterior.complete({*causes, *minor}) <= LIKELY
    verdict = _verdict(posterior, causes, more=more, in_doubt=doubtful)
    if verdict == "ambiguous" and not causes:
        causes = _leading(posterior)
    return Judgement(
        verdict=verdict,
        causes=dict(sorted(causes.items(), key=lambda item: -item[1])),
        minor={name: p for name, p in minor.items() if name not in causes},
        depends_on=variables(posterior, missing, ruled_out or frozenset()) if left else (),
    )


def variables(posterior: Posterior, missing: ResidualTorque, ruled_out: frozenset[str]) -> tuple[str, ...]:
    """Variables of what no name explains: of what stands in the place of names, else of the discrepancy's torque.

    What was ruled out there as a prediction still is the likeliest to say on what it depends. Where there is no
    discrepancy, by the residual torque.
    """
    best = posterior.best
    found = variables_instead(best.names) or variables_instead(ruled_out) or _carrying(best.discrepancy)
    found = found or tuple(curve.variable for curve in missing.curves if curve.share > 1.0 - SURE)
    each = dict.fromkeys(variable for several in found for variable in several.split(" and "))
    return tuple(effects_over(variable, best.fit.log.axis) for variable in each if variable != _CONSTANT)


def variables_instead(names: frozenset[str]) -> tuple[str, ...]:
    """Variables of what stands without a name among those of a set."""
    return tuple(variable for name in sorted(names.intersection(unnamed)) for variable in unnamed[name].variables)


def _carrying(discrepancy: Discrepancy) -> tuple[str, ...]:
    """The most telling variable of a discrepancy, others that tell nearly as much, and what it needs beside it."""
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
    alike = (variable for variable in ranked if alone[variable] >= _CARRIES * alone[ranked[0]])
    return tuple(dict.fromkeys((*alike, *needed)))


def alternatives(posterior: Posterior, name: str) -> tuple[tuple[str, float], ...]:
    """Names that the sets without it have in its place, with the probability of those sets; not what has none.

    In its place is what is likelier without it than beside it.
    """
    beside: dict[str, float] = {}
    instead: dict[str, float] = {}
    for names, p in posterior.reported.items():
        found = beside if name in names else instead
        for other in names.difference(posterior.best.names, unnamed):
            found[other] = found.get(other, 0.0) + p
    told = posterior.probability(name)
    alike = {n: p for n, p in instead.items() if p * told > beside.get(n, 0.0) * (1.0 - told)}
    return tuple(sorted(((n, p) for n, p in alike.items() if p >= LISTED), key=lambda item: -item[1]))


def log_bayes(posterior: Posterior, name: str) -> float:
    """Log marginal likelihood of the best set that holds an effect, or a wider form of it, less that of the others."""
    best = {True: -np.inf, False: -np.inf}
    for each in posterior.sets:
        holds = any(name in special_cases(other) for other in each.names)
        best[holds] = max(best[holds], each.log_marginal)
    return float(best[True] - best[False])


def of_the_measurement(name: str) -> bool:
    """Whether an effect is one of how the torque of the log was measured, and not of the machine."""
    return name in catalogue and bool(catalogue[name].measured)


def in_doubt(probability: float) -> bool:
    """Whether an effect with such a probability may be there, and may not."""
    return 1.0 - SURE < probability <= SURE


def _verdict(posterior: Posterior, causes: Mapping[str, float], *, more: bool, in_doubt: bool) -> Verdict:
    if posterior.nameless() > SURE:
        return "unknown"
    of_the_machine = [name for name in causes if not of_the_measurement(name)]
    if causes and (of_the_machine or not more):
        return "named" if all(p > SURE for p in causes.values()) and not in_doubt else "ambiguous"
    if more:
        return "unknown"
    nothing = posterior.reported.get(frozenset(), 0.0)
    return "nothing_missing" if nothing > LIKELY or not posterior.names() else "ambiguous"


def _leading(posterior: Posterior) -> dict[str, float]:
    """The name that is told with the highest probability."""
    told = {name: posterior.probability(name) for each in posterior.sets for name in each.names.difference(unnamed)}
    best = max(told, key=lambda name: told[name])
    return {best: told[best]}
