"""Diagnose: from a log to what the model gets wrong, by name, with the gain on data that nothing has seen."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from diagnosis.candidates import Choice, chosen
from diagnosis.diagnosis import Diagnosis
from diagnosis.effects_against_curves import curves_explain_far_more, supported_effects
from diagnosis.extrapolation import extrapolation_warning
from diagnosis.falsification import error_rises, falsified_sentence, squared_innovations, withdrawn_causes
from diagnosis.formula_suggestion import suggested_formula
from diagnosis.grading import graded
from diagnosis.holdout import cut, inverse_errors, measure_gain, parts, remaining
from diagnosis.holdout_refit import holdout_differences
from diagnosis.identifiability import blind_spots, standstill
from diagnosis.model_probability import CLEAR, NONE
from diagnosis.multimodal_likelihood import with_scatter
from diagnosis.nonparametric_residual import ResidualModel
from diagnosis.refit import estimates
from diagnosis.repeated_runs import repeats
from diagnosis.residual_torque import ResidualTorque, effects_over, residual_torque
from diagnosis.result import MENTIONED, Cause, Verdict
from diagnosis.state_gaussian_process import beside_gaussian_process, displaced_sentences
from diagnosis.stepwise_round import Addition
from diagnosis.stepwise_search import Outcome, forward_selection, reselected
from identification.between_run_differences import between_run_differences
from identification.errors import Unidentifiable
from identification.fit import base_model, fit_with_prior, known_of
from identification.fit_result import Fit
from identification.log_like import LogLike, log_of
from identification.prior_knowledge import Fixed, Pairs
from identification.threads import without_blas_threads
from identification.time_stamp_jitter import evenly_timed
from plant.effects.effect import Array
from plant.effects.nonparametric_curve import Nonparametric
from plant.servo import ServoModel

_NOISE = 0.1  # share of the torque up to which a random load may pass for noise
_TELLING = 0.2  # share of the residual torque's variance from which a variable is said to carry it


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
    null = fit_with_prior(log, start, known, progress)
    if (still := standstill(null)) is not None:
        raise Unidentifiable(still)
    if null.failed is not None:
        raise Unidentifiable(f"The fit of the base model failed: {null.failed}")
    log, held_out = null.log, evenly_timed(held_out) if null.log.evenly_timed else held_out
    warnings = [*log.warnings, *log.repairs, *log.notes, *said]
    if null.unidentifiable:
        warnings.append(f"This log does not determine {', '.join(null.unidentifiable)} of the base model.")
    outcome = forward_selection(null, effects, progress=progress)
    near = curves_explain_far_more(outcome)
    outcome = replace(outcome, additions=()) if near else reselected(outcome, progress)
    null = outcome.base
    if null.log.colour:
        warnings.append(
            f"The measurement noise is coloured, with a memory of about {outcome.fit.noise_memory:.2g} s; "
            "fits and probabilities account for it."
        )

    for name in outcome.random_walk_like:
        warnings.append(
            f"{effects[name].title.capitalize()} is rejected: a random-walk disturbance torque explains as much. "
            "To decide, record a longer log or repeat a run."
        )
    warnings.extend(
        f"{effects[name].title.capitalize()} is rejected: it only changes the observer that follows the log, and "
        "explains no motion."
        for name in outcome.filters
    )
    warnings.extend(
        f"{effects[name].title.capitalize()} is rejected: parts of the log contradict each other about it. The model "
        "lacks another effect."
        for name in outcome.inconsistent
    )
    tell("fitting non-parametric curves")
    surely = beside_gaussian_process(outcome.additions, null, progress)
    warnings.extend(displaced_sentences(outcome.additions, surely))
    outcome, beside, doubts = supported_effects(replace(outcome, additions=surely))
    warnings.extend(doubts)
    warnings.extend(
        f"{effects[name].title.capitalize()} is rejected: such a cause hardly ever has the fitted values."
        for name in outcome.strange
    )
    if outcome.fit.model.chaotic:
        tell("estimating the standard error of the gap from parts of the log")
        outcome, beside = _with_scatter(outcome, beside)
    missing = residual_torque(outcome.fit)
    again = repeats(outcome.fit)
    depends_on = _depends_on(outcome.fit, missing, beside)
    unnamed = (
        bool(beside.path or depends_on or outcome.strange or outcome.refused or outcome.inconsistent)
        or missing.excess > _NOISE
        or (again is not None and again.deterministic)
    )
    path = [null, *(addition.fit for addition in outcome.additions), *beside.path]
    tell("measuring the gain on validation data")
    gain, squares, replays = measure_gain(held_out, path)
    final = path[-1]
    warnings.extend(blind_spots(null, final))
    further = extrapolation_warning(held_out, log)
    observer = max(fit.bandwidth for fit in path)
    predicted = [squared_innovations(held_out, fit, observer) for fit in path]
    if (refuted := falsified_sentence(predicted[0], predicted[-1])) is not None:
        warnings.append(" ".join(filter(None, (refuted, further))))
    found = _causes(outcome, final, squares)
    # Judged by the fits with effects alone: beside a non-parametric curve the value of an effect is not known.
    judged = _causes(outcome, outcome.fit, predicted)
    kept, why_not = withdrawn_causes(
        judged, log, refuted=further is None and error_rises(predicted[0], predicted[len(outcome.additions)])
    )
    causes = tuple(cause for cause in found if cause.effect in {each.effect for each in kept})
    tell("weighing the effects beside what no effect explains")
    grades = graded(causes, outcome.fit, null, catalogue=len(effects), depends_on=depends_on)
    warnings.extend(filter(None, (grades.warning,)))
    warnings.extend(why_not)
    left = repeats(final)
    if left is not None:
        warnings.append(str(left))
    if (apart := between_run_differences(final)) is not None:
        warnings.append(apart)
    if (formula := suggested_formula(final)) is not None:
        warnings.append(formula)
    opinions = holdout_differences(final, held_out)
    if opinions:
        warnings.append(f"Fitted to the validation data alone, the model has {'; '.join(map(str, opinions))}.")
    return Diagnosis(
        verdict=_verdict(grades.causes, unnamed or len(grades.causes) < len(found)),
        causes=grades.causes,
        minor=grades.minor,
        sets=grades.sets,
        unknown=grades.unknown,
        gain=gain,
        torque_error=inverse_errors(log, held_out, null.model, final.model),
        unexplained=remaining(gain, depends_on),
        warnings=tuple(warnings),
        base=null,
        extended=final,
        residual_before=residual_torque(null),
        residual_after=residual_torque(final),
        candidates=outcome.candidates,
        replays=replays,
        whiteness=predictable_share(final.innovations),
    )


def _with_scatter(outcome: Outcome, beside: ResidualModel) -> tuple[Outcome, ResidualModel]:
    """The same with standard errors that know of the other peaks of a multimodal likelihood."""
    if outcome.additions:
        *first, last = outcome.additions
        outcome = replace(outcome, additions=(*first, replace(last, fit=with_scatter(last.fit))))
    if beside.path:
        beside = replace(beside, path=(*beside.path[:-1], with_scatter(beside.path[-1])))
    return outcome, beside


def _depends_on(final: Fit, missing: ResidualTorque, beside: ResidualModel) -> tuple[str, ...]:
    """Variables of what is carried without a name, else of what would pay; where much is missing, by the picture."""
    carried_on = [
        effect for fit in beside.path[-1:] for effect in fit.model.effects if isinstance(effect, Nonparametric)
    ]
    found = carried_on or beside.seen
    if found or missing.excess <= _NOISE:
        variables = dict.fromkeys(variable for one in found for variable in one.variables)
        return tuple(effects_over(name, final.log.axis) for name in variables)
    return tuple(curve.variable for curve in missing.curves if curve.share > _TELLING)


def _verdict(causes: Sequence[Cause], unnamed: bool) -> Verdict:
    if not causes:
        return "unknown" if unnamed else "nothing_missing"
    return "named" if all(cause.probability >= CLEAR for cause in causes) else "ambiguous"


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
    rivals = [(n, p) for n, p in addition.odds.items() if n not in (addition.effect, NONE) and p >= MENTIONED]
    return tuple(rivals)


def predictable_share(innovations: np.ndarray, lags: int = 10) -> float:
    """Share of the innovations' variance that a linear predictor from their last values explains, less chance [-]."""
    n = innovations.size - lags
    past = np.column_stack([innovations[lags - lag : lags - lag + n] for lag in range(1, lags + 1)])
    now = innovations[lags:]
    coefficients = np.linalg.lstsq(past, now, rcond=None)[0]
    explained = 1.0 - float(np.mean((now - past @ coefficients) ** 2) / max(float(np.mean(now**2)), 1e-300))
    return float(np.clip(explained - lags / n, 0.0, 1.0))
