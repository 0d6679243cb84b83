"""The extended model fitted to the validation data alone, to compare its parameters.

The estimates differ if the machine has changed between the logs, if one log excites what the other does not, or if an
effect stands for something else. So no effect is sure if one needs very different values on validation data.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from diagnosis.explanation.wording import joined_words, measured, title_of
from diagnosis.levels import LIKELY
from identification.fit_result import Fit, FittedParameter
from identification.log import Log
from identification.problem import Problem, first_states
from identification.standard_errors import fit_with_errors
from plant.effects.effect import Array
from plant.effects.nonparametric import unnamed

_APART = 4.0  # standard errors from which two estimates differ
_MATTERS = 0.05  # smallest relevant difference: relative, or in rad for a phase
_TRIED = 15  # iterations from each start
_SHARPER = 5.0  # ratio of the standard errors from which the validation data determine a parameter much better


@dataclass(frozen=True, kw_only=True)
class HoldoutDifference:
    """A parameter with a different or far more precise estimate on validation data.

    `value` is None if only the validation data determine it. `much` is whether it differs by more than half.
    """

    parameter: str
    much: bool
    value: float | None
    std: float | None
    held_out_value: float
    held_out_std: float
    unit: str

    def __str__(self) -> str:
        """As "presliding hysteresis: stiffness 465000 ± 49000 N/m instead of 218000 ± 18000 N/m"."""
        parameter = self.parameter.replace(".", ": ").replace("_", " ")
        here = f"{parameter} {measured(self.held_out_value, self.held_out_std, self.unit)}"
        if self.value is None:
            return f"{here}, which the fitted data cannot tell"
        return f"{here} instead of {measured(self.value, self.std, self.unit)}"


def holdout_differences(fit: Fit, holdout: Log) -> tuple[HoldoutDifference, ...]:
    """Parameters of a fit that differ by more than four standard errors on validation data, or are more precise."""
    first, last = min(run.time[0] for run in holdout.runs), max(run.time[-1] for run in holdout.runs)
    instants = [
        spec.name
        for spec, value in zip(fit.model.parameters, fit.model.values, strict=True)
        if spec.unit == "s" and spec.lower < 0.0 and not first <= value <= last  # it is not in these data
    ]
    log = replace(holdout, colour=fit.log.colour)
    problem = Problem.of(log, fit.model, fixed=instants, known=fit.known)
    points = [problem.pack(*at) for at in product(_starts(fit), (first_states(log), _begun(log, fit, instants)))]
    tried = [problem.minimise(point, fit.bandwidth, 0.0, _TRIED) for point in points]
    best = min(tried, key=lambda minimum: float(np.nan_to_num(minimum.equations.cost, nan=np.inf)))
    if not np.isfinite(best.equations.cost) or not (best := problem.ended(best, fit.bandwidth)).converged:
        return ()
    other = fit_with_errors(problem, fit.bandwidth, best, best.evaluations)
    compared = (_compared(a, b) for a, b in zip(fit.parameters, other.parameters, strict=True))
    found = [opinion for opinion in compared if opinion is not None]
    return tuple(replace(each, much=each.much and _rules_out(other, each, instants)) for each in found)


def _rules_out(other: Fit, difference: HoldoutDifference, instants: list[str]) -> bool:
    """Whether the validation data exclude the fitted value of a parameter, by the likelihood with it.

    A standard error describes the likelihood near its maximum only. Far from there it may be flat, as that of a
    stiffness is from which the load has slipped.

    Args:
        other: the fit to the validation data.
        difference: of the parameter.
        instants: parameters that these data do not have.
    """
    values = dict(zip(other.model.names, other.model.values.tolist(), strict=True))
    values[difference.parameter] = difference.value
    model = other.model.with_values(list(values.values()))
    problem = Problem.of(other.log, model, fixed=[*instants, difference.parameter], known=other.known)
    held = problem.minimise(problem.pack(model.values, other.initial), other.bandwidth, 0.0)
    lost = other.log_likelihood - fit_with_errors(problem, other.bandwidth, held, held.evaluations).log_likelihood
    return not 2.0 * lost < _APART**2


def contradiction(
    sure: Collection[str],
    gains: Sequence[Mapping[str, tuple[float, float]]],
    differences: Sequence[HoldoutDifference],
) -> str | None:
    """What in the validation data contradicts effects that seem sure; None if nothing does.

    A right set describes other data of the machine too. If one of its effects has very different values there, or makes
    the prediction worse, each may stand for another.

    Args:
        sure: names of these effects.
        gains: reduction of the validation error by each effect, and its standard error, for each measure of the error.
            An effect that all of them find harmful contradicts.
        differences: parameters that differ on the validation data.
    """
    different = [str(each) for each in differences if each.much and each.parameter.split(".")[0] in sure]
    if different:
        return f"fitted to the validation data alone, the model has {'; '.join(different)}"
    asked = [name for name in sure if all(name in each for each in gains)]
    harmful = sorted(title_of(name) for name in asked if all(each[name][0] < 0.0 for each in gains))
    return f"they are predicted better without {joined_words(harmful)}" if harmful else None


def validation_warnings(differences: Sequence[HoldoutDifference], contradicted: str | None) -> tuple[str, ...]:
    """A warning about other parameters in the validation data, if there are any."""
    if contradicted is not None:
        return (f"The validation data contradict the model, so no effect is sure: {contradicted}.",)
    if not differences:
        return ()
    return (f"Fitted to the validation data alone, the model has {'; '.join(map(str, differences))}.",)


def _begun(log: Log, fit: Fit, instants: list[str]) -> Array:
    """(R, n) initial states of another log with the parameters of a fit.

    From states off the motion, a descent may first change the parameters; if these are wrong, so are the states.
    """
    still = Problem.of(log, fit.model, fixed=[*instants, *fit.model.names], known=fit.known)
    best = still.minimise(still.pack(fit.model.values, first_states(log)), fit.bandwidth, 0.0)
    return still.unpack(best.point)[1]


def _starts(fit: Fit) -> list[Array]:
    """The fitted values (P,), and the same with all phases shifted by quarters of a turn: a descent shifts none far."""
    phases = [place for place, name in enumerate(fit.model.names) if name.endswith(".phase")]
    quarters = 0.5 * np.pi * np.arange(4 if phases else 1)
    starts = [fit.model.values for _ in quarters]
    for values, quarter in zip(starts, quarters, strict=True):
        values[phases] += quarter
    return starts


def _compared(here: FittedParameter, there: FittedParameter) -> HoldoutDifference | None:
    if here.fixed or there.fixed or here.name.split(".")[0] in unnamed:
        return None
    if there.value is None or there.std is None or there.at_bound:
        return None
    value, much = there.value, False
    if here.value is not None and here.std is not None:
        apart, size = value - here.value, abs(here.value)
        if here.name.endswith(".phase"):
            apart = float(np.remainder(apart + np.pi, 2.0 * np.pi) - np.pi)
            value, size = here.value + apart, 1.0
        differs = abs(apart) > max(_APART * np.hypot(here.std, there.std), _MATTERS * size)
        sharper = here.std > max(_SHARPER * there.std, _MATTERS * size)
        if here.at_bound or not (differs or sharper):
            return None
        much = bool(differs and abs(apart) > LIKELY * size)
    return HoldoutDifference(
        parameter=here.name,
        much=much,
        value=here.value,
        std=here.std,
        held_out_value=value,
        held_out_std=there.std,
        unit=here.unit,
    )
