"""The diagnosis of a log that is read in one way, with given validation data.

Usually the motion is predicted from the torque. If the torque follows the motion, as in a tight loop, the torque is
predicted from the motion (`identification.inverse_log`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from diagnosis.description import better_description, likeliest, worse_description
from diagnosis.diagnosis import Diagnosis
from diagnosis.evidence.marginal import Explanation
from diagnosis.evidence.posterior import Posterior
from diagnosis.evidence.search_over_sets import explore, explore_from
from diagnosis.extrapolation import extrapolation_warning
from diagnosis.falsification import Tenable, predicts_worse, tenable
from diagnosis.formula_suggestion import suggested_formula
from diagnosis.holdout import measure_gain, remaining
from diagnosis.holdout_refit import contradiction, holdout_differences, validation_warnings
from diagnosis.identifiability import identifiability_warnings, standstill
from diagnosis.inverse_model import (
    explains_less_than_a_regression,
    inverse_errors,
    torque_follows,
    torque_predicted_worse,
    unexplained_in_validation,
    unexplained_torque,
)
from diagnosis.levels import CLEARLY, DECISIVE, LIKELY, SURE
from diagnosis.long_log import stretches
from diagnosis.redundant_effects import beside_curves
from diagnosis.refit import estimates
from diagnosis.rejection import rejected
from diagnosis.repeated_runs import repeats
from diagnosis.residual_torque import ResidualTorque, effects_over, residual_torque, torque_of
from diagnosis.result import Cause, EffectSet, Minor, Unknown
from diagnosis.validation_only import only_in_validation
from diagnosis.verdict import Judgement, alternatives, doubted, judged, log_bayes, variables_instead
from identification.between_run_differences import between_run_differences
from identification.errors import Unidentifiable
from identification.fit import fit_with_prior
from identification.fit_result import Fit
from identification.inverse_log import inverse_log
from identification.log import Log
from identification.prior_knowledge import PriorKnowledge
from identification.slower_observer import behind_a_slower_observer, torque_log_likelihood_gain
from identification.time_stamp_jitter import evenly_timed
from plant.effects.effect import Array, Effect
from plant.effects.nonparametric import of_reading, unnamed
from plant.servo import ServoModel

_FAILED = "The fit of the base model failed: "


def diagnose_once(
    recorded: tuple[Log, Log],
    start: ServoModel,
    known: PriorKnowledge,
    effects: Mapping[str, type[Effect]],
    tell: Callable[[str], None],
    notes: Sequence[str],
    *,
    inverse: bool = False,
) -> Diagnosis:
    """Diagnosis of estimation and validation data.

    Args:
        recorded: both.
        start, known, effects, tell: as in `diagnose`.
        notes: warnings on how the data were divided.
        inverse: predict the torque from the motion.

    Raises:
        Unidentifiable: the load does not move, or the fit of the base model failed.
    """
    log, held_out = map(inverse_log, recorded) if inverse else recorded
    log, shorter = stretches(log)
    tell("fitting the base model")
    null, doubtful = _base_fit(log, start, known, tell)
    held_out = evenly_timed(held_out) if null.log.evenly_timed else held_out
    sets = explore(null, _shown(log, effects), tell, doubtful)
    found = tenable(null, sets.fits.values(), held_out)
    while explore_from(sets, found.fit):
        found = tenable(null, sets.fits.values(), held_out)
    failed = None if doubtful is None else doubtful.failed
    if failed is not None and not _explains_torque(likeliest(found.posterior, null)):
        raise Unidentifiable(torque_follows(log) or _FAILED + failed)
    tell("fitting non-parametric curves")
    found, final = beside_curves(null, sets.fits.values(), found, held_out)
    best, named = found.posterior.best, found.fit
    missing, again = residual_torque(named), repeats(named)
    shows = final is not named or (again is not None and again.deterministic)
    if final is not named and predicts_worse(named, final, held_out):
        final = named
    ruled_out = found.likeliest if found.lost > CLEARLY + DECISIVE else None
    tell("measuring the gain on validation data")
    gain, _, replays = measure_gain(held_out, [null, final])
    judgement = judged(found.posterior, missing, shows=shows, ruled_out=ruled_out)
    left = remaining(gain, judgement.depends_on)
    alone, most = None, left.share > 0.5  # most of the error remains unexplained
    if judgement.verdict != "unknown" and (not judgement.causes or most):
        alone = only_in_validation(final, held_out)
    described = final
    if not found.without and better_description(final, other := likeliest(found.posterior, null), held_out):
        described = other
    if not judgement.causes and worse_description(null, described, held_out):
        described = null
    if described is not final:
        final = described
        gain, _, replays = measure_gain(held_out, [null, final])
        left = remaining(gain, judgement.depends_on)
    beside = best.discrepancy.posterior
    something = judgement.verdict == "named" and most and beside.something > SURE
    differences = holdout_differences(final, held_out)
    sure = [name for name, p in judgement.causes.items() if p > SURE]
    contradicted = contradiction(sure, [found.gains, found.several_steps], differences)
    judgement = judgement if contradicted is None else doubted(judgement)
    logs = recorded if inverse else (null.log, held_out)
    torque_error = inverse_errors(*logs, null.model, final.model)
    absurd = None if inverse else unexplained_torque(final)
    nowhere = None if inverse else unexplained_in_validation(final, held_out)
    if alone is not None or absurd is not None or something:
        judgement = replace(judgement, verdict="unknown")
    return Diagnosis(
        verdict=judgement.verdict,
        causes=tuple(sorted((_cause(found, judgement, name) for name in judgement.causes), key=lambda c: -c.rms)),
        minor=tuple(_minor(found, name, p) for name, p in judgement.minor.items()),
        sets=_sets(found.posterior, judgement),
        unknown=_unknown(found, judgement, missing),
        without=found.without,
        rejected=rejected(null, found.posterior, effects, {*judgement.causes, *judgement.minor}, found.falsified),
        gain=gain,
        torque_error=torque_error,
        unexplained=left,
        only_in_validation=None if alone is None else str(alone),
        contradicted=contradicted,
        warnings=(
            *_of_data(null, [*notes, *filter(None, (shorter,))]),
            *filter(None, (absurd or nowhere or torque_predicted_worse(torque_error),)),
            *_of_the_end(null, final, held_out),
            *validation_warnings(differences, contradicted),
        ),
        base=null,
        extended=final,
        residual_before=residual_torque(null),
        residual_after=missing if final is named else residual_torque(final),
        replays=replays,
        whiteness=predictable_share(final.innovations),
    )


def _shown(log: Log, effects: Mapping[str, type[Effect]]) -> Mapping[str, type[Effect]]:
    """The candidates; of an inverse model those that act on the load."""
    if log.response != "torque":
        return effects
    shown = {name: kind for name, kind in effects.items() if log.shows(kind)}
    if not shown:
        raise Unidentifiable("No candidate acts on the load, and an inverse model shows no other effect.")
    return shown


def _base_fit(
    log: Log, start: ServoModel, known: PriorKnowledge, tell: Callable[[str], None]
) -> tuple[Fit, Fit | None]:
    """The fit of the base model; and the likeliest one, if that has failed or explains none of the torque.

    Then its observer follows the load whatever the torque is, and the base model is fitted with a slower one.
    """
    first = fit_with_prior(log, start, known, tell, of_the_sensor=True)
    if first.failed is not None:  # with white noise, an observer follows a closed loop for any torque
        first = fit_with_prior(log, start, known, tell)
    if (still := standstill(first)) is not None:
        raise Unidentifiable(still)

    def serves(fit: Fit) -> bool:  # if the base model lacks too much to be fitted, none may explain the torque
        return first.failed is not None or unexplained_torque(fit) is None

    if log.response != "torque" and (first.failed is not None or not serves(first)):
        slower = behind_a_slower_observer(log, start, known, serves)
        if slower is not None:
            return slower, first
    if first.failed is not None:
        follows = torque_follows(log) if log.response != "torque" else None
        raise Unidentifiable(follows or _FAILED + first.failed)
    return first, None


def _explains_torque(fit: Fit) -> bool:
    """Whether the torque moves the load of a fitted model, and as much of it as a regression explains."""
    if torque_log_likelihood_gain(fit) < DECISIVE:
        return False
    return fit.log.response == "torque" or not explains_less_than_a_regression(fit)


def _cause(found: Tenable, judgement: Judgement, name: str) -> Cause:
    posterior = found.posterior
    fit = _holder(found, name)
    rms, share = torque_of(fit, name)
    gain, gain_std = found.gains.get(name, (0.0, 0.0))
    return Cause(
        effect=name,
        probability=judgement.causes[name],
        alternatives=alternatives(posterior.tempered, name),
        parameters=estimates(fit, name),
        share=share,
        rms=rms,
        gain=gain,
        gain_std=gain_std,
        log_bayes=log_bayes(posterior, name),
    )


def _unknown(found: Tenable, judgement: Judgement, missing: ResidualTorque) -> Unknown:
    """The unexplained part: discrepancy and non-parametric effects; `missing` is the residual torque of the causes.

    Where something is missing its size is at least that of the residual torque: no smooth function follows all of it.
    """
    posterior, best = found.posterior, found.posterior.best
    beside, torques = best.discrepancy.posterior, frozenset(unnamed) - of_reading
    level = float(np.sqrt(np.mean(missing.command**2)))
    sizes = [torque_of(found.fit, name)[0] / level for name in sorted(best.names & torques)]
    probability = max(beside.material, posterior.nonparametric(torques))
    if level > 0.0 and (judgement.verdict == "unknown" or probability > SURE):
        whole = np.concatenate([run.drive for run in found.fit.log.runs])
        of_all = missing.excess * level / float(np.sqrt(np.mean(whole**2)))
        sizes.append(min(of_all, 1.0))  # the torque of a model may be worse than none
    return Unknown(
        probability=probability,
        measurement_error=max(beside.measurement_error, posterior.nonparametric(of_reading)),
        depends_on=judgement.depends_on,
        share=max((best.likelihood.share, *sizes)),
    )


def _minor(found: Tenable, name: str, probability: float) -> Minor:
    fit = _holder(found, name)
    rms, share = torque_of(fit, name)
    return Minor(effect=name, probability=probability, share=share, rms=rms, parameters=estimates(fit, name))


def _holder(found: Tenable, name: str) -> Fit:
    """The fit with the estimates of an effect: the extended model if it has the effect, else the best set with it."""
    if name in found.without:
        return found.fit
    return next(each.fit for each in found.posterior.sets if name in each.names)


def _sets(posterior: Posterior, judgement: Judgement) -> tuple[EffectSet, ...]:
    fitted = {each.names: each for each in reversed(posterior.sets)}
    axis = posterior.best.fit.log.axis

    def instead(names: frozenset[str]) -> tuple[str, ...]:
        return tuple(effects_over(variable, axis) for variable in variables_instead(names))

    def unknown(each: Explanation | None) -> tuple[str, ...]:
        if each is posterior.best:
            return judgement.depends_on
        if each is None or each.discrepancy.posterior.something <= LIKELY:
            return ()
        explained = each.discrepancy.explained_by()
        return tuple(effects_over(v, axis) for v in explained if explained[v] == max(explained.values()))

    return tuple(
        EffectSet(
            effects=tuple(sorted(names.difference(unnamed))),
            unknown=instead(names) or unknown(each),
            probability=p,
            log_marginal=None if each is None else each.log_marginal,
            fit=None if each is None else each.fit,
        )
        for names, p in posterior.tempered.reported.items()
        for each in (fitted.get(names),)
    )


def _of_data(null: Fit, notes: Sequence[str]) -> list[str]:
    """Warnings about the log."""
    warnings = [*null.log.warnings, *null.log.repairs, *null.log.notes, *notes]
    if null.unidentifiable:
        warnings.append(f"This log does not determine {', '.join(null.unidentifiable)} of the base model.")
    if null.log.colour:
        warnings.append(
            f"The measurement noise is coloured, with a memory of about {null.noise_memory:.2g} s; "
            "fits and probabilities account for it."
        )
    return warnings


def _of_the_end(null: Fit, final: Fit, held_out: Log) -> list[str]:
    """Warnings about the final model: confounded parameters, extrapolation, repeated runs."""
    further, left, apart = extrapolation_warning(held_out, null.log), repeats(final), between_run_differences(final)
    found = [
        *identifiability_warnings(null, final),
        further,
        None if left is None else str(left),
        apart,
        suggested_formula(final),
    ]
    return [each for each in found if each is not None]


def predictable_share(innovations: Array, lags: int = 10) -> float:
    """Share of the innovations' variance that an AR model of order `lags` explains, less the value by chance [-]."""
    n = innovations.size - lags
    past = np.column_stack([innovations[lags - lag : lags - lag + n] for lag in range(1, lags + 1)])
    now = innovations[lags:]
    coefficients = np.linalg.lstsq(past, now, rcond=None)[0]
    explained = 1.0 - float(np.mean((now - past @ coefficients) ** 2) / max(float(np.mean(now**2)), 1e-300))
    return float(np.clip(explained - lags / n, 0.0, 1.0))
