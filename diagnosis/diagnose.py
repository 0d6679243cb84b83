"""Diagnose: from a log to what the model gets wrong, by name, with the gain on data that nothing has seen."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from diagnosis.belief import believed, only_near
from diagnosis.candidates import Choice, chosen
from diagnosis.curves import Carried
from diagnosis.diagnosis import Diagnosis
from diagnosis.extrapolation import goes_further
from diagnosis.holdout import cut, inverse_errors, measure_gain, parts, remaining
from diagnosis.identifiability import blind_spots, standstill
from diagnosis.missing_torque import MissingTorque, missing_torque, named_on
from diagnosis.odds import NONE
from diagnosis.refit import estimates
from diagnosis.refutation import rises, spoken_against, squared_innovations, withdrawn
from diagnosis.repeated_runs import repeats
from diagnosis.result import Cause, Verdict
from diagnosis.round import Addition
from diagnosis.rugged import with_scatter
from diagnosis.search import Outcome, forward, weighed_again
from diagnosis.second_opinion import second_opinions
from diagnosis.suggestion import suggestion
from diagnosis.surface import beside_surface, gave_way
from identification.disagreement import disagreement
from identification.errors import Unidentifiable
from identification.fit import base_model, fit_knowing, known_of
from identification.fit_result import Fit
from identification.known import Fixed, Pairs
from identification.log_like import LogLike, log_of
from identification.side_by_side import without_blas_threads
from identification.stamps import evenly_timed
from plant.effects.curve import Unnamed
from plant.effects.effect import Array
from plant.servo import ServoModel

_NOISE = 0.1  # share of the torque up to which a random load may pass for noise
_TELLING = 0.2  # share of the missing torque's variance from which a variable is said to carry it
_MENTION = 1e-4  # probability from which a rival is listed


@without_blas_threads
def diagnose(
    log: LogLike,
    base: ServoModel | None = None,
    holdout: LogLike | None = None,
    *,
    fixed: Fixed = (),
    bounds: Pairs | None = None,
    prior: Pairs | None = None,
    candidates: Sequence[Choice] | None = None,
    exclude: Collection[str] = (),
    force: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Find out what a model misses in a log.

    Args:
        log: measured runs, also as a path, a DataFrame or arrays by name.
        base: the model to start from; by default eqs. (4) and (6) of the paper, whose dead zone is then part of the
            model and not a cause to be named.
        holdout: runs to measure the gain on; by default some runs of the log, or the last part of its only one.
        fixed, bounds, prior: what is known of parameters, as in `identification.fit`; also of those of effects that may
            be named, `{"coulomb_friction.torque": (0.1, 0.3)}`.
        candidates: effects that may be named, by their name in the catalogue or as classes; also effects that the
            catalogue does not have. By default the whole catalogue.
        exclude: names of effects that may not.
        force: diagnose also a log that is unusable (`Log.faults`).
        progress: called with a line of text at each step.

    Returns:
        Verdict, causes, gain and the data of the pictures.

    Raises:
        UnusableLog: the log, or the one to measure the gain on, has faults that no model fits.
        BadParameter: base and log do not fit together, or an effect is not known.
        Unidentifiable: the load does not move, or the fit of the base model failed.
    """
    log, effects = log_of(log).usable(force=force), chosen(candidates, exclude)
    start = base_model(log) if base is None else base
    known = known_of(fixed, bounds, prior, start, effects.values(), stated=base is not None)
    tell = progress or (lambda line: None)
    log, held_out, said = parts(log, None if holdout is None else log_of(holdout).usable(force=force))
    tell("fitting the base model")
    null = fit_knowing(log, start, known, progress)
    if (still := standstill(null)) is not None:
        raise Unidentifiable(still)
    if null.failed is not None:
        raise Unidentifiable(f"The fit of the base model failed: {null.failed}")
    log, held_out = null.log, evenly_timed(held_out) if null.log.evenly_timed else held_out
    warnings = [*log.warnings, *log.repairs, *log.notes, *said]
    if null.unidentifiable:
        warnings.append(f"This log cannot tell {', '.join(null.unidentifiable)} of the base model.")
    outcome = forward(null, effects, progress=progress)
    near = only_near(outcome)
    outcome = replace(outcome, additions=()) if near else weighed_again(outcome, progress)
    null = outcome.base
    if null.log.colour:
        warnings.append(
            f"The noise of the reading is not white, it lasts for about {outcome.fit.noise_memory:.2g} s; "
            "all fits and odds allow for that."
        )

    for name in outcome.wanderers:
        warnings.append(
            f"{effects[name].title.capitalize()} would fit, but no better than a load torque that wanders at random; "
            "a longer log or a repeated run would tell."
        )
    warnings.extend(
        f"{effects[name].title.capitalize()} would fit, but only mends the observer that the model needs to follow the "
        "log; it explains no motion."
        for name in outcome.filters
    )
    warnings.extend(
        f"{effects[name].title.capitalize()} would fit, but the parts of the log disagree about it; the model lacks "
        "something else."
        for name in outcome.uneven
    )
    tell("looking for what has no name")
    surely = beside_surface(outcome.additions, null, progress)
    warnings.extend(gave_way(outcome.additions, surely))
    outcome, beside, doubts = believed(replace(outcome, additions=surely))
    warnings.extend(doubts)
    warnings.extend(
        f"{effects[name].title.capitalize()} would fit, but only with values that such a cause hardly has."
        for name in outcome.strange
    )
    if outcome.fit.model.chaotic:
        tell("asking parts of the log how sure the gap is")
        outcome, beside = _with_scatter(outcome, beside)
    missing = missing_torque(outcome.fit)
    again = repeats(outcome.fit)
    depends_on = _depends_on(outcome.fit, missing, beside)
    unnamed = (
        bool(beside.path or depends_on or outcome.strange or outcome.refused or outcome.uneven)
        or missing.excess > _NOISE
        or (again is not None and again.deterministic)
    )
    path = [null, *(addition.fit for addition in outcome.additions), *beside.path]
    tell("measuring the gain on held-out data")
    gain, squares, replays = measure_gain(held_out, path)
    final = path[-1]
    warnings.extend(blind_spots(null, final))
    further = goes_further(held_out, log)
    observer = max(fit.bandwidth for fit in path)
    predicted = [squared_innovations(held_out, fit, observer) for fit in path]
    if (refuted := spoken_against(predicted[0], predicted[-1])) is not None:
        warnings.append(" ".join(filter(None, (refuted, further))))
    found = _causes(outcome, final, squares)
    # Judged by the fits of the names alone: beside a curve that has no name, what a name is worth is not known.
    judged = _causes(outcome, outcome.fit, predicted)
    kept, why_not = withdrawn(
        judged, log, refuted=further is None and rises(predicted[0], predicted[len(outcome.additions)])
    )
    causes = tuple(cause for cause in found if cause.effect in {each.effect for each in kept})
    warnings.extend(why_not)
    left = repeats(final)
    if left is not None:
        warnings.append(str(left))
    if (apart := disagreement(final)) is not None:
        warnings.append(apart)
    if (formula := suggestion(final)) is not None:
        warnings.append(formula)
    opinions = second_opinions(final, held_out)
    if opinions:
        warnings.append(f"Fitted to the held-out data alone, the model has {'; '.join(map(str, opinions))}.")
    return Diagnosis(
        verdict=_verdict(outcome, causes, unnamed or len(causes) < len(found)),
        causes=causes,
        gain=gain,
        torque_error=inverse_errors(log, held_out, null.model, final.model),
        unexplained=remaining(gain, depends_on),
        warnings=tuple(warnings),
        base=null,
        extended=final,
        missing_before=missing_torque(null),
        missing_after=missing_torque(final),
        candidates=outcome.candidates,
        replays=replays,
        whiteness=predictable_share(final.innovations),
    )


def _with_scatter(outcome: Outcome, beside: Carried) -> tuple[Outcome, Carried]:
    """The same with standard errors that know of the other peaks of a rugged likelihood."""
    if outcome.additions:
        *first, last = outcome.additions
        outcome = replace(outcome, additions=(*first, replace(last, fit=with_scatter(last.fit))))
    if beside.path:
        beside = replace(beside, path=(*beside.path[:-1], with_scatter(beside.path[-1])))
    return outcome, beside


def _depends_on(final: Fit, missing: MissingTorque, beside: Carried) -> tuple[str, ...]:
    """Variables of what is carried without a name, else of what would pay; where much is missing, by the picture."""
    carried_on = [effect for fit in beside.path[-1:] for effect in fit.model.effects if isinstance(effect, Unnamed)]
    found = carried_on or beside.seen
    if found or missing.excess <= _NOISE:
        variables = dict.fromkeys(variable for one in found for variable in one.variables)
        return tuple(named_on(name, final.log.axis) for name in variables)
    return tuple(curve.variable for curve in missing.curves if curve.share > _TELLING)


def _verdict(outcome: Outcome, causes: Sequence[Cause], unnamed: bool) -> Verdict:
    if not causes:
        return "unknown" if unnamed else "nothing_missing"
    told = {cause.effect for cause in causes}
    return "named" if all(one.clear for one in outcome.additions if one.effect in told) else "ambiguous"


def _causes(outcome: Outcome, final: Fit, squares: list[Array]) -> tuple[Cause, ...]:
    """The additions as causes, the one with the largest evidence first."""
    causes = []
    for addition, before, after in zip(outcome.additions, squares, squares[1:], strict=False):
        gain, gain_std = cut(before, after)
        causes.append(
            Cause(
                effect=addition.effect,
                probability=addition.odds[addition.effect],
                alternatives=_rivals(addition),
                parameters=estimates(final, addition.effect),
                gain=gain,
                gain_std=gain_std,
                evidence=addition.evidence,
            )
        )
    return tuple(sorted(causes, key=lambda cause: -cause.evidence))


def _rivals(addition: Addition) -> tuple[tuple[str, float], ...]:
    rivals = [(n, p) for n, p in addition.odds.items() if n not in (addition.effect, NONE) and p >= _MENTION]
    return tuple(rivals)


def predictable_share(innovations: np.ndarray, lags: int = 10) -> float:
    """Share of the innovations' variance that a linear predictor from their last values explains, less chance [-]."""
    n = innovations.size - lags
    past = np.column_stack([innovations[lags - lag : lags - lag + n] for lag in range(1, lags + 1)])
    now = innovations[lags:]
    coefficients = np.linalg.lstsq(past, now, rcond=None)[0]
    explained = 1.0 - float(np.mean((now - past @ coefficients) ** 2) / max(float(np.mean(now**2)), 1e-300))
    return float(np.clip(explained - lags / n, 0.0, 1.0))
