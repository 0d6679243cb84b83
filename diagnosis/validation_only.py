"""Whether validation data show an effect that the estimation data do not show.

The search does not see what happens only in the validation data, such as an end stop that is reached there first, or a
changed payload. Such an effect is detected by multi-step prediction errors in windows with restarts. The logarithms of
their mean squares are compared with those of the estimation data: all of them by the test of Welch (1947), the largest
by Student's t for one further sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from diagnosis.holdout import restart_window, squared_errors
from diagnosis.levels import DECISIVE, LIKELY
from diagnosis.refit import fitted_to
from identification.fit_result import Fit
from identification.log import Log
from identification.run import Run
from plant.effects.effect import Array
from plant.servo import ServoModel


@dataclass(frozen=True, kw_only=True)
class OnlyInValidation:
    """The window of the validation data with the largest error.

    Attributes:
        label: of its run.
        begin, end: of the window, since the log's start [s].
        ratio: of its root mean square over that of the estimation data [-].
    """

    label: str
    begin: float
    end: float
    ratio: float

    def __str__(self) -> str:
        """As "From 9.9 to 10.9 s of run 1 the error is 150 times that on the estimation data"."""
        place = f"From {self.begin:.4g} to {self.end:.4g} s of {self.label}"
        return f"{place} the error is {self.ratio:.2g} times that on the estimation data"


def only_in_validation(fit: Fit, validation: Log, model: ServoModel | None = None) -> OnlyInValidation | None:
    """The worst window of the validation data if their errors are significantly too large; else None.

    Args:
        fit: to the estimation data.
        validation: data that the fit has not used.
        model: to predict these data; by default that of the fit.
    """
    window = restart_window(validation)
    fitted = np.array([square for _, _, square in _windows(fit.log, fit.model, window)])
    parts = _windows(validation, model or fit.model, window)
    validated = np.array([square for _, _, square in parts])
    if fitted.size < 2 or not validated.size or LIKELY**2 * np.mean(validated) <= np.mean(fitted):
        return None  # of another motion up to twice the error is expected
    worst = int(np.argmax(validated))
    logs = (np.log(np.maximum(each, np.finfo(float).tiny)) for each in (fitted, validated))
    if _by_chance(*logs) > np.exp(-DECISIVE):
        return None
    run, first, _ = parts[worst]
    last = min(first + round(window / run.sample_time), len(run)) - 1
    return OnlyInValidation(
        label=run.label,
        begin=float(run.time[first] - run.start),
        end=float(run.time[last] - run.start),
        ratio=float(np.sqrt(validated[worst] / max(np.mean(fitted), np.finfo(float).tiny))),
    )


def is_of_parameters(fit: Fit, validation: Log) -> bool:
    """Whether the model follows the validation data with other parameter values: then the machine has changed."""
    return only_in_validation(fit, validation, fitted_to(validation, fit).model) is None


def _by_chance(fitted: Array, validated: Array) -> float:
    """p-value that `validated` (M,) is larger than `fitted` (N,), as a whole or in one value, by chance."""
    from scipy.stats import t as student
    from scipy.stats import ttest_ind_from_stats

    tiny = np.finfo(float).tiny
    scatter, other = (max(float(each.std(ddof=1)), tiny) if each.size > 1 else tiny for each in (fitted, validated))
    one = student.sf((validated.max() - fitted.mean()) / (scatter * np.sqrt(1.0 + 1.0 / fitted.size)), fitted.size - 1)
    every = 1.0
    if validated.size > 1:
        sample, rest = (validated.mean(), other, validated.size), (fitted.mean(), scatter, fitted.size)
        every = float(ttest_ind_from_stats(*sample, *rest, equal_var=False, alternative="greater").pvalue)
    return float(2.0 * min(validated.size * one, every))


def _windows(log: Log, model: ServoModel, window: float) -> list[tuple[Run, int, float]]:
    """Run, first sample and mean squared error of each window; incomplete windows are left out."""
    squares, _ = squared_errors(log, model, window)
    found, begun = [], 0
    for run in log.runs:
        each: Array = np.full(len(run), np.nan)
        each[run.valid] = squares[begun : begun + int(run.valid.sum())]
        begun += int(run.valid.sum())
        length = round(window / run.sample_time)
        starts = [first for first in range(0, len(run) - length + 1, length) if run.valid[first : first + length].any()]
        found += [(run, first, float(np.nanmean(each[first : first + length]))) for first in starts]
    return found
