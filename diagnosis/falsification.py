"""What speaks against a name once it is found: the held-out data, or the values that it came out with."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from diagnosis.explanation.wording import change, measured, sentence_case, title_of
from diagnosis.holdout import bounded, cut
from diagnosis.model_probability import CLEAR
from diagnosis.result import Cause, Estimate
from identification.fit_result import Fit
from identification.log import Log
from identification.problem import Problem, first_states
from plant.effects import catalogue
from plant.effects.effect import Array

_SURELY = 2.0  # standard errors


def falsified_sentence(before: Array, after: Array) -> str | None:
    """A sentence if held-out data refute what was added: squared one-step errors (T,) significantly larger with it."""
    if not error_rises(before, after):
        return None
    return (
        f"The validation data contradict the extension: with it the one-step error rises there ("
        f"{change(*cut(before, after))}). Do not rely on the effects that were added."
    )


def error_rises(before: Array, after: Array) -> bool:
    """Whether squared errors (T,) are surely larger after something was added."""
    gained, std = cut(before, after)
    return gained < -_SURELY * std


def squared_innovations(log: Log, fit: Fit, bandwidth: float) -> Array:
    """(T,) squared one-step prediction errors of a fit on runs that it has not seen; their initial states are fitted.

    The error of a simulation over a single run is mostly that of the initial state, found in its first samples, and of
    parameters known to a few digits; it does not tell a true model from a false one. One-step errors do, where what is
    compared is corrected by the same observer.

    Args:
        log: the runs.
        fit: of another log.
        bandwidth: of the observer [rad/s].
    """
    problem = Problem.of(replace(log, colour=fit.log.colour), fit.model, fixed=fit.model.names)
    begun = problem.pack(fit.model.values, first_states(log))
    values, initial = problem.unpack(problem.minimise(begun, bandwidth, 0.0).point)
    told = problem.predictor.predict(values, initial, bandwidth=bandwidth, width=0.0, sensitivities=False)
    errors = np.concatenate([one.innovations[run.valid] for one, run in zip(told, log.runs, strict=True)])
    return bounded(errors) ** 2


def withdrawn_causes(causes: Iterable[Cause], log: Log, *, refuted: bool) -> tuple[tuple[Cause, ...], list[str]]:
    """The causes that may still be told, and one sentence for each that may not.

    A name is not told where all its sizes are zero within their standard errors, where a torque is beyond what the log
    commands, nor where it brings nothing on held-out data that refute what was added.

    Args:
        causes: as they were found, with the share by which the one-step error on held-out data fell as their gain.
        log: that they were found on.
        refuted: whether held-out data refute what was added, where the log has been before.
    """
    kept, told = [], []
    for cause in causes:
        doubted = cause.probability < CLEAR  # it is told with its doubt, and nobody relies on it
        why = None if doubted else _why_not(cause, log, refuted=refuted)
        if why is None:
            kept.append(cause)
        else:
            told.append(f"{sentence_case(title_of(cause.effect))} is not told: {why}.")
    return tuple(kept), told


def _why_not(cause: Cause, log: Log, *, refuted: bool) -> str | None:
    torques = {name: value for name, value in cause.parameters.items() if value.unit == log.command_unit}
    sizes = torques | {name: cause.parameters[name] for name in _sizes(cause)}
    if sizes and all(_is_zero(value) for value in sizes.values()):
        return f"its {_said(sizes)} {'is' if len(sizes) == 1 else 'are'} zero within the standard error"
    most = max(float(np.max(np.abs(run.drive))) for run in log.runs)
    beyond = {name: value for name, value in torques.items() if abs(value.value) > most}
    if beyond:
        return f"its {_said(beyond)} is beyond all that the log commands, {most:.3g} {log.command_unit}"
    if refuted and cause.gain <= _SURELY * cause.gain_std:
        return "it brings no gain on the validation data, which contradict the extension"
    return None


def _sizes(cause: Cause) -> list[str]:
    """Parameters of a known effect that count in torque and may be zero: with all of them zero nothing is there."""
    kind = catalogue.get(cause.effect)
    specs = () if kind is None else kind.parameters()
    return [s.name for s in specs if "{torque}" in s.unit and s.lower <= 0.0 and s.name in cause.parameters]


def _is_zero(value: Estimate) -> bool:
    return value.std is not None and abs(value.value) <= value.std


def _said(values: dict[str, Estimate]) -> str:
    return " and ".join(f"{name.replace('_', ' ')} ({measured(v.value, v.std, v.unit)})" for name, v in values.items())
