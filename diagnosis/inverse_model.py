"""Whether a fitted model explains the torque of its log, and not only how the motion goes on.

An observer follows a smooth motion from sample to sample whatever the torque is. Where the torque follows the motion,
as in a tight loop or beside other moving joints, the likelihood of the motion can prefer a model in which the torque
does nothing: its inertia is much too large. The inverse model shows that. A regression of the torque on the measured
motion tells whether the torque can be explained at all.
"""

from __future__ import annotations

import numpy as np

from diagnosis.explanation.wording import joined_words, percent
from diagnosis.jackknife import jackknife
from diagnosis.levels import LIKELY, SIGNIFICANT
from diagnosis.residual_torque import noise_cutoff
from diagnosis.result import TorqueError
from identification.fit_result import Fit
from identification.inverse import inverse_cutoff, torque_error_samples
from identification.log import Log
from identification.regression import TorqueRegression
from plant.servo import ServoModel
from plant.units import printed

_ANOTHER_UNIT = 10.0  # ratio of the torques of one motion in two logs that only another unit explains


def inverse_errors(estimation: Log, held_out: Log, before: ServoModel, after: ServoModel) -> TorqueError:
    """Relative error of the inverse model with both models on both logs."""
    cutoff = inverse_cutoff(estimation)
    found = {
        "estimation_before": _inverse_error(estimation, before, cutoff),
        "estimation_after": _inverse_error(estimation, after, cutoff),
        "held_out_before": _inverse_error(held_out, before, cutoff),
        "held_out_after": _inverse_error(held_out, after, cutoff),
    }
    return TorqueError(
        cutoff=cutoff,
        **{name: error for name, (error, _) in found.items()},
        std={name: std for name, (_, std) in found.items()},
    )


def _inverse_error(log: Log, model: ServoModel, cutoff: float) -> tuple[float, float]:
    """Relative error of the inverse model over a log, and its standard error."""
    squares = [record**2 for record in torque_error_samples(log, model, cutoff=cutoff)]

    def relative(missed: float, torque: float) -> float:
        if torque > 0.0:
            return float(np.sqrt(missed / torque))
        return float(missed > 0.0)  # a model that lets no torque through explains none of what the motion needs

    return relative(*(float(np.mean(square)) for square in squares)), jackknife(relative, *squares)


def unexplained_torque(fit: Fit) -> str | None:
    """That a model explains none of the torque of its log though a regression explains most; None if that is not so."""
    error = _least_inverse_error(fit, fit.log)
    follows = torque_follows(fit.log, _sound_cutoff(fit)) if error >= 1.0 else None
    if follows is None:
        return None
    return f"The model does not explain the torque: its inverse model has an error of {100.0 * error:.3g} %. {follows}"


def explains_less_than_a_regression(fit: Fit) -> bool:
    """Whether a regression on the motion explains the torque of a log significantly better than a fitted model does."""
    cutoff = inverse_cutoff(fit.log)
    error, std = _inverse_error(fit.log, fit.model, cutoff)
    return error - TorqueRegression.of(fit.log, cutoff).error > SIGNIFICANT * std


def _least_inverse_error(fit: Fit, log: Log) -> float:
    """Relative error of the inverse model over a log, in the usual band or that without encoder noise."""
    return min(_inverse_error(log, fit.model, each)[0] for each in (inverse_cutoff(fit.log), _sound_cutoff(fit)))


def _sound_cutoff(fit: Fit) -> float:
    """Cutoff of the band in which the noise of the encoder does not count [Hz]."""
    return min(noise_cutoff(fit), inverse_cutoff(fit.log))


def torque_follows(log: Log, cutoff: float | None = None) -> str | None:
    """That a regression on the motion explains most of the torque, and what follows if no fitted model does."""
    found = TorqueRegression.of(log, inverse_cutoff(log) if cutoff is None else cutoff)
    if found.share < LIKELY:
        return None
    model = ServoModel(axis=log.axis, gravity=0.0, torque_unit=log.torque_unit)
    units = {spec.name: printed(spec.unit) for spec in model.parameters} | {"coulomb_friction": log.command_unit}
    names = ("inertia", *(("gravity",) if log.axis == "rotary" else ()), "viscous_friction", "coulomb_friction")
    if any(run.positioned for run in log.runs):
        advice = (
            "the drive does not follow its set-point by the law of the model; it may limit its torque or feed it "
            "forward. Do not use the fitted parameters; give the drive's torque or current as the command."
        )
    else:
        advice = (
            "in this log the torque follows the motion, as in a tight loop or beside other moving joints, and does not "
            "predict it. Do not use the fitted parameters; record a log in which only this axis moves and the torque "
            "is commanded."
        )
    words = [f"{name.replace('_', ' ')} {getattr(found, name):.3g} {units[name]}" for name in names]
    text = [each.replace("coulomb", "Coulomb") for each in words]
    return (
        f"A regression of the torque on the measured motion has an error of {100.0 * found.error:.3g} % "
        f"({joined_words(text)}): {advice}"
    )


def unexplained_in_validation(fit: Fit, held_out: Log) -> str | None:
    """That a model explains none of the torque of the validation data, or that its unit is another one; else None."""
    ours, error = TorqueRegression.of(fit.log, _sound_cutoff(fit)), _least_inverse_error(fit, held_out)
    ratio = ours.factor_on(held_out) if ours.error**2 <= 1.0 - LIKELY else 1.0
    if max(ratio, 1.0 / ratio) >= _ANOTHER_UNIT:
        return (
            f"The same motion needs {ratio:.3g} times the command in the validation data: check the unit of the "
            "command in both logs."
        )
    if error < 1.0:
        return None
    return (
        "The model explains none of the torque of the validation data: its inverse model has an error of "
        f"{percent(error)} there."
    )


def torque_predicted_worse(error: TorqueError) -> str | None:
    """That the extended model predicts the torque of the validation data less well than the base model; else None."""
    before, after = error.held_out_before, error.held_out_after
    scatter = float(np.hypot(error.std["held_out_before"], error.std["held_out_after"]))
    if not after - before > SIGNIFICANT * scatter:
        return None
    return (
        f"The extended model predicts the torque of the validation data less well than the base model (error of the "
        f"inverse model {100.0 * before:.3g} -> {100.0 * after:.3g} %): use it for simulation, not as a feedforward."
    )
