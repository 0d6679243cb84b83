"""What rules an effect out, whatever its probability: implausible values or validation data.

An effect is ruled out if the log determines none of its sizes (or of its parameters, if it has no size), if all sizes
are zero within their standard errors, if its torque is larger than any in the log, if its fitted values are
implausible, or if the prediction of the validation data is significantly worse with it. If the prediction is worse, but
not significantly, the loss of log-likelihood is subtracted from its evidence. A set with a significantly worse
prediction than the base model is ruled out as a whole.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.evidence.marginal import Explanation
from diagnosis.evidence.posterior import Posterior
from diagnosis.explanation.wording import measured, percent
from diagnosis.holdout import bounded, cut, restart_window, scoring_window, squared_errors
from diagnosis.jackknife import BLOCKS
from diagnosis.levels import LIKELY, SIGNIFICANT
from diagnosis.refit import estimates, is_plausible, settled, without
from diagnosis.residual_torque import torque_of
from diagnosis.result import Estimate
from identification.fit_result import Fit
from identification.log import Log
from identification.problem import Problem, first_states
from identification.threads import in_threads
from identification.unsettled_start import unsettled_if_shown
from plant.effects import catalogue
from plant.effects.effect import Array
from plant.effects.nonparametric import unnamed
from plant.servo import ServoModel


@dataclass(frozen=True, kw_only=True, eq=False)
class Tenable:
    """The sets of effects that are not ruled out.

    Attributes:
        posterior: over these sets.
        fit: of the leading set, with the observer that it needs without a discrepancy; the base model's if that set is
            empty.
        without: for each effect of the leading set, the model without it, fitted again.
        gains: for each of these effects, relative reduction of the validation error by it, and its standard error.
        several_steps: the same of the error of multi-step prediction.
        falsified: for each effect that is ruled out, the reason.
        lost: log Bayes factor of the most probable set of all over the most probable one that is not ruled out.
        likeliest: effects of the most probable set of all.
    """

    posterior: Posterior
    fit: Fit
    without: Mapping[str, Fit]
    gains: Mapping[str, tuple[float, float]]
    several_steps: Mapping[str, tuple[float, float]]
    falsified: Mapping[str, str]
    lost: float
    likeliest: frozenset[str]


def tenable(base: Fit, explanations: Collection[Explanation], validation: Log) -> Tenable:
    """The posterior over the sets that neither their values nor validation data rule out.

    Args:
        base: fit of the base model.
        explanations: all fitted sets with their evidence, with each observer.
        validation: runs that no fit has used.
    """
    left, falsified = _possible(explanations)
    against: dict[str, Array] = {}
    validated: dict[frozenset[str], _Validated] = {}
    while True:
        posterior = Posterior.over(left, against)
        leading = posterior.best
        if leading.names not in validated:
            validated[leading.names] = _Validated.of(base, leading, validation)
        here = validated[leading.names]
        found = here.rejections
        wrong = {name: each.worse for name, each in found.items() if each.worse > 0.0}
        worst = max(wrong, key=lambda name: wrong[name], default=None)
        rest = [each for each in left if worst not in each.names]
        if worst is not None and rest:
            reason = f"the validation error is larger with it, by {percent(wrong[worst])}"
            left, falsified = rest, {worst: reason} | falsified
            continue
        others = [each for each in left if each.names != leading.names]
        if here.worse_together and others:
            left = others
            continue
        fresh = {n: each.against for n, each in found.items() if n not in against and each.against.sum() < 0.0}
        if not fresh:
            break
        against |= fresh
    first = max(explanations, key=lambda each: each.log_marginal)
    return Tenable(
        posterior=posterior,
        fit=here.fit,
        without=here.less,
        gains=here.gains,
        several_steps=here.several_steps,
        falsified=falsified,
        lost=first.log_marginal - posterior.sets[0].log_marginal,
        likeliest=first.names,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Validated:
    """A set of effects with the result of its validation.

    Attributes:
        fit: of the set, with the observer that it needs without a discrepancy.
        less: for each effect the model without it, fitted again.
        gains, several_steps: of each effect, as in `Tenable`.
        rejections: evidence of the validation data against each effect.
        worse_together: whether the prediction is significantly worse with the set than with the base model.
    """

    fit: Fit
    less: Mapping[str, Fit]
    gains: Mapping[str, tuple[float, float]]
    several_steps: Mapping[str, tuple[float, float]]
    rejections: Mapping[str, _Rejection]
    worse_together: bool

    @classmethod
    def of(cls, base: Fit, explanation: Explanation, validation: Log) -> _Validated:
        """Validate a set; without effects the fit is that of the base model."""
        names = sorted(explanation.names)
        fit = settled(explanation.fit, base.bandwidth) if names else base
        fits = [base] if len(names) == 1 else in_threads(lambda name: without(fit, name, base.bandwidth), names)
        less = dict(zip(names, fits, strict=True))
        gained = in_threads(lambda name: _gain_of_several_steps(less[name], fit, validation), names)
        several = dict(zip(names, gained, strict=True))
        against = in_threads(lambda name: _rejection(less[name], fit, validation, several[name]), names)
        rejections = dict(zip(names, against, strict=True))
        worse_together = len(names) > 1 and predicts_worse(base, fit, validation)
        window = scoring_window(base, fit)  # as for the gain of the whole model
        scored = in_threads(
            lambda each: squared_errors(validation, each.model, window, each.bandwidth)[0], [fit, *less.values()]
        )
        gains = {name: cut(before, scored[0]) for name, before in zip(less, scored[1:], strict=True)}
        return cls(
            fit=fit, less=less, gains=gains, several_steps=several, rejections=rejections, worse_together=worse_together
        )


def errors_of_many_steps(model: ServoModel, validation: Log) -> Array:
    """(T,) squared errors of multi-step prediction.

    The simulation restarts in each window. Errors of one long simulation are a single sample: once it deviates, all
    later errors follow from that.
    """
    return squared_errors(validation, model, restart_window(validation))[0]


def predicts_worse(less: Fit, fit: Fit, validation: Log) -> bool:
    """Whether a fit predicts validation data significantly worse than the fit of a smaller model."""
    return _rejection(less, fit, validation, _gain_of_several_steps(less, fit, validation)).worse > 0.0


def _gain_of_several_steps(less: Fit, fit: Fit, validation: Log) -> tuple[float, float]:
    """Relative reduction of the error of multi-step prediction by a fit, and its standard error."""
    return cut(*(errors_of_many_steps(each.model, validation) for each in (less, fit)))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Rejection:
    """Evidence of the validation data against an effect.

    Attributes:
        worse: significant relative increase of the prediction error with the effect; 0 if there is none.
        against: (B,) change of the log-likelihood of the validation data with the effect, by block; it counts only if
            its sum is negative.
    """

    worse: float
    against: Array


def _rejection(less: Fit, fit: Fit, validation: Log, gain: tuple[float, float]) -> _Rejection:
    """Evidence against an effect, from a fit without it, one with it, and its gain in multi-step prediction.

    The one-step error must not rise significantly. The multi-step error must not rise significantly to more than
    double: uncertain parameters of a small effect alone can make it somewhat larger. If one of the two errors falls
    significantly, there is no evidence against the effect.
    """
    bandwidth = max(less.bandwidth, fit.bandwidth)
    before, after = (_squared_innovations(validation, each, bandwidth) for each in (less, fit))
    tested = ((*cut(before, after), 0.0), (*gain, 1.0 / LIKELY - 1.0))  # to double: less than half was there
    if any(fell > SIGNIFICANT * std for fell, std, _ in tested):
        return _Rejection(worse=0.0, against=np.zeros(BLOCKS))
    worse = max(-fell if fell + SIGNIFICANT * std < -least else 0.0 for fell, std, least in tested)
    return _Rejection(worse=worse, against=_log_likelihood(after) - _log_likelihood(before))


def _log_likelihood(squares: Array) -> Array:
    """(B,) log-likelihood of blocks of white noise (T,) of unknown variance, from its squares."""
    variance = max(float(np.mean(squares)), 1e-300)
    log_density = -0.5 * (squares / variance + np.log(variance))
    return np.array([part.sum() for part in np.array_split(log_density, BLOCKS)])


def _squared_innovations(log: Log, fit: Fit, bandwidth: float) -> Array:
    """(T,) squared one-step prediction errors of a fit on validation runs, from fitted initial states."""
    problem = Problem.of(replace(log, colour=fit.log.colour), fit.model, fixed=fit.model.names)
    begun = problem.pack(fit.model.values, first_states(log))
    problem, best = unsettled_if_shown(problem, problem.minimise(begun, bandwidth, 0.0), bandwidth)
    values, initial = problem.unpack(best.point)
    predictions = problem.predictor.predict(values, initial, bandwidth=bandwidth, width=0.0, sensitivities=False)
    errors = np.concatenate([one.innovations[run.valid] for one, run in zip(predictions, log.runs, strict=True)])
    return bounded(errors) ** 2


def _possible(explanations: Collection[Explanation]) -> tuple[list[Explanation], dict[str, str]]:
    """The sets with possible values, and for each effect that is in none of them the reason.

    A set has the observer that gives it the most evidence among those with which its values are possible.
    """
    kept, falsified = dict[frozenset[str], Explanation](), dict[str, str]()
    for each in sorted(explanations, key=lambda each: -each.log_marginal):
        if each.names in kept:
            continue
        wrong = {name: why for name in sorted(each.names) if (why := _impossible(each, name)) is not None}
        if not wrong:
            kept[each.names] = each
        falsified = wrong | falsified
    left = {name for names in kept for name in names}
    return list(kept.values()), {name: why for name, why in falsified.items() if name not in left}


def _impossible(explanation: Explanation, name: str) -> str | None:
    """Why the values of a fitted effect rule it out; None if they do not."""
    fit = explanation.fit
    if name in unnamed:
        return None if np.isfinite(explanation.log_marginal) else "this log does not determine the curve"
    values = estimates(fit, name)
    torques = {key: value for key, value in values.items() if value.unit == fit.log.command_unit}
    sizes = {key: values[key] for key in {*torques, *_sizes(name)} & values.keys()}
    lines = [line for key in sizes or values if not (line := fit[f"{name}.{key}"]).fixed]
    unclear = [(line.value is None and not _is_determined_jointly(fit, line.name)) or line.at_bound for line in lines]
    if (unclear and all(unclear)) or not np.isfinite(explanation.log_marginal):
        return "this log does not separate its parameters from the other parameters"
    if sizes and all(_is_zero(value) for value in sizes.values()):
        return f"its {_listed(sizes)} {'is' if len(sizes) == 1 else 'are'} zero within the standard error"
    gone = {key: value for key, value in torques.items() if fit[f"{name}.{key}"].at_bound and value.value == 0.0}
    if gone:  # e.g. friction in one of two directions: then a simpler effect explains as much
        return f"its {_listed(gone)} {'is' if len(gone) == 1 else 'are'} zero, at a bound"
    frequencies = [fit[f"{name}.{spec}"] for spec in _frequencies(name)]
    if any(line.at_bound or line.value is None for line in frequencies):
        return "its resonance is faster than this log can show"
    if not is_plausible(fit, name):
        return "the fitted values are implausible for this effect"
    most = max(float(np.max(np.abs(run.drive))) for run in fit.log.runs)
    if any(abs(value.value) > most for value in torques.values()):  # an amplitude that the motion may not reach
        rms, unit = torque_of(fit, name)[0], fit.log.command_unit
        if rms > most:
            return f"its torque ({measured(rms, None, unit)} rms) is larger than any in the log, {most:.3g} {unit}"
    return None


def _is_determined_jointly(fit: Fit, size: str) -> bool:
    """Whether a size is undetermined only because it is collinear with other parameters of its effect.

    An example is the stiffness of an end stop that was touched once: it is collinear with the position of the stop.
    """
    effect = size.split(".")[0]
    own = [row for row, place in enumerate(fit.free) if fit.model.names[place].split(".")[0] == effect]
    here = [fit.model.names[fit.free[row]] for row in own].index(size)
    covariance = fit.covariance[np.ix_(own, own)]
    value = fit.model.values[fit.free[own[here]]]
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    precision = np.linalg.pinv(covariance / np.outer(scale, scale), hermitian=True)[here, here]
    alone = scale[here] / np.sqrt(max(precision, 1e-300))
    return bool(alone < abs(value) < scale[here])


def _sizes(name: str) -> list[str]:
    """Size parameters of a catalogue effect: if all of them are zero, the effect vanishes.

    They are torques that may be zero, or angles and delays that cannot be negative.
    """
    kind = catalogue.get(name)
    specs = () if kind is None else kind.parameters()
    return [
        spec.name
        for spec in specs
        if ("{torque}" in spec.unit and spec.lower <= 0.0)
        or (spec.unit == "{angle}" and spec.lower == 0.0)
        or (spec.unit == "s" and spec.lower >= 0.0)
    ]


def _frequencies(name: str) -> list[str]:
    """Parameters of a catalogue effect that are resonance frequencies; the sampling rate limits what can be seen."""
    kind = catalogue.get(name)
    return [] if kind is None else [spec.name for spec in kind.parameters() if spec.swing and spec.fitted]


def _is_zero(value: Estimate) -> bool:
    return value.std is not None and abs(value.value) <= value.std


def _listed(values: Mapping[str, Estimate]) -> str:
    return " and ".join(
        f"{name.replace('_', ' ')} ({measured(value.value, value.std, value.unit)})"
        for name, value in sorted(values.items())
    )
