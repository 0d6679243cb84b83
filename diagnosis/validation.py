"""Whether a better model is better on what it has not seen, before it is believed."""

from __future__ import annotations

import numpy as np

from diagnosis.holdout import bounded, restart_window, scoring_window, squared_errors, standard_errors
from diagnosis.predictive_likelihood import LAST, log_likelihood_by_sample, predictive_loss
from diagnosis.refit import follows_anything
from identification.fit_result import Fit
from identification.predictor import Predictor
from plant.effects.effect import Array

_SIGNIFICANT = 2.0  # standard errors
LOUD = 100.0  # rise of the log-likelihood of which a quarter should show in a quarter of the record
_MORE = 1.1  # times the squared error; less may come from states that it is restarted from, or a load that wanders
_DOUBLED = 2.0  # times the squared error, which a few states from which it begins anew do not make
_FOLLOWS = 0.1  # share of the squared error below which a simulation has clearly not lost its run
_HALF = 0.5  # of the squared error, or of the share that a part of the record should have of the evidence


def passes_validation(before: Fit, after: Fit, *, must_show: bool = False) -> bool:
    """Whether an extended model stands beside its predecessor on what neither was chosen by.

    The odds have decided on one-step predictions of the whole record. Besides,

    - the free simulation must not get significantly worse, and by a tenth; and predictions of the last part of each
      run, after a fit to the first part, not significantly either, unless the simulation gets significantly better.
    - An effect for which the record speaks loudly must show there too: one of the two must get significantly better,
      or, since an effect may act in a few places only, the simulation's error must be halved, or the last part must
      bring half of its share of the evidence, unless behind an observer that follows anything.
    - So must what has no name to speak for it (`must_show`), and it must not err more from initial states that are not
      fitted to the whole run, as it will be used: a torque over time may only make up for those.
    - Where only an observer keeps the model on its runs, what speaks loudly must not err more when the simulation is
      restarted again and again, by as much, nor twice as much however seldom: one that has lost its run says little,
      and an observer helps a model that bends the wrong way. What has no name and leaves a slow observer work, as a
      load that wanders does, must then err significantly less, or half as much. Where the model follows its runs from
      end to end, or has a tenth of the error left, a restart would only take from it what a memory holds.
    - Nor may a gap need an observer where its predecessor needs none: without it, too, it must err less.
    """
    simulation, left = simulation_gain(before, after)
    if _errs_more(simulation, left):
        return False
    if must_show and _share_as_used(before, after) > 1.0:
        return False
    loud = must_show or after.log_likelihood - before.log_likelihood > LOUD
    if loud and _needs_holding(before, after):
        return False
    if loud and _may_stray(after) and left > _FOLLOWS:
        restarted, more = multi_step_gain(before, after)
        if _errs_more(restarted, more) or more > _DOUBLED:
            return False
        if must_show and restarted < _SIGNIFICANT and more > _HALF and not follows_anything(after):
            return False
    if simulation > _SIGNIFICANT or left < _HALF:
        return True
    bandwidth = max(before.bandwidth, after.bandwidth)
    predicted = standard_errors(
        log_likelihood_by_sample(after, bandwidth) - log_likelihood_by_sample(before, bandwidth)
    )
    if not loud or predicted > _SIGNIFICANT:
        return predicted > -_SIGNIFICANT
    if must_show or follows_anything(after):
        return False
    share = LAST * (after.log_likelihood - before.log_likelihood)
    return predictive_loss(before, after) < -_HALF * share


def _errs_more(gain: float, left: float) -> bool:
    """Whether the squared error rose, by that many standard errors to that share of what it was."""
    return gain < -_SIGNIFICANT and left > _MORE


def _needs_holding(before: Fit, after: Fit) -> bool:
    """Whether a chaotic model errs no less without the observer it was fitted with, which its predecessor has not."""
    if before.bandwidth or not after.bandwidth or not after.model.chaotic:
        return False
    alone, _ = _fallen(_squared_from_fit(before), _squared_from_fit(after))
    return alone < _SIGNIFICANT


def _may_stray(fit: Fit) -> bool:
    """Whether only an observer keeps a model on its runs: they hold no position, and it does not follow them alone."""
    return fit.bandwidth > 0.0 and not any(run.positioned for run in fit.log.runs)


def simulation_gain(before: Fit, after: Fit) -> tuple[float, float]:
    """How much better an extended model simulates the estimation runs than its predecessor: how surely, and how much.

    One-step predictions alone can prefer a term that bends the model the wrong way over longer times. A model that was
    fitted without an observer has followed its runs from end to end. If it is chaotic, or its predecessor could not do
    without one, it is judged there; restarts from noisy states would hide most of what it does better.

    Returns:
        By how many standard errors the squared error fell, and what share of it is left [-].
    """
    window = scoring_window(before, after)
    follows = not after.bandwidth and (after.model.chaotic or before.bandwidth > 0.0)
    if window is None or follows:
        return _fallen(_squared_from_fit(before), _squared_from_fit(after))
    return _gain(before, after, window)


def multi_step_gain(before: Fit, after: Fit) -> tuple[float, float]:
    """The same over the estimation runs, simulated anew again and again."""
    return _gain(before, after, restart_window(before.log))


def _share_as_used(before: Fit, after: Fit) -> float:
    """Share that is left as the gain is measured on held-out runs: from what their first moments tell."""
    return _gain(before, after, scoring_window(before, after))[1]


def _gain(before: Fit, after: Fit, window: float | None) -> tuple[float, float]:
    (old, _), (new, _) = (squared_errors(before.log, fit.model, window) for fit in (before, after))
    return _fallen(old, new)


def _fallen(old: Array, new: Array) -> tuple[float, float]:
    return standard_errors(old - new), float(np.mean(new)) / max(float(np.mean(old)), 1e-300)


def _squared_from_fit(fit: Fit) -> Array:
    """(T,) squared error of a free simulation of the runs that were fitted, from their estimated initial states."""
    predictor = Predictor(model=fit.model, runs=fit.log.runs, free=(), substeps=fit.substeps)
    runs = predictor.predict(fit.model.values, fit.initial, bandwidth=0.0, width=0.0, sensitivities=False)
    errors = np.concatenate([p.errors for p in runs])
    return bounded(errors) ** 2
