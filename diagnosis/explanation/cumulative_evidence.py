"""Data for the plots of one cause: its cumulative evidence along the log, and the residual torque over a variable.

Both compare two fits of one log: a set of effects, and the same set without the cause.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from diagnosis.residual_torque import Curve, residual_torque
from identification.fit_result import Fit
from plant.drive_table import harmonics
from plant.effects.effect import TURN, Array, Stage

_TELLING = 0.3  # least share of the predicted torque's variance that the variable must explain
_PARTS = 10  # parts of the log, to see whether the evidence comes from one moment


@dataclass(frozen=True, kw_only=True, eq=False)
class CumulativeEvidence:
    """Evidence along the log.

    Attributes:
        time: (T,) along the runs, one after the other [s].
        evidence: (T,) cumulative log-likelihood with the cause less that without it.
    """

    time: Array
    evidence: Array

    @property
    def densest(self) -> tuple[float, float]:
        """Largest share of the evidence from one tenth of the log [-], and the time in the middle of that [s]."""
        edges = np.linspace(0, self.time.size - 1, _PARTS + 1).astype(int)
        shares = np.diff(self.evidence[edges]) / max(float(self.evidence[-1]), 1e-300)
        best = int(np.argmax(shares))
        return float(shares[best]), float(self.time[(edges[best] + edges[best + 1]) // 2])


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualOverVariable:
    """Residual torque without a cause, over the variable that shows the cause best, and the prediction of the cause.

    Attributes:
        variable, unit: variable of the plot and its unit.
        torque_unit: of the residual torque.
        centre: (B,) middle of each bin.
        before, band: (B,) mean residual torque without the cause and half width of its 95 % band.
        after: (B,) mean residual torque with the cause.
        predicted: (B,) mean difference of the two residual torques: the residual that the cause predicts without it.
        share: of the predicted torque's variance that the variable explains [-].
    """

    variable: str
    unit: str
    torque_unit: str
    centre: Array
    before: Array
    band: Array
    after: Array
    predicted: Array
    share: float

    @property
    def standing_out(self) -> int:
        """Number of bins in which the predicted torque is larger than the band."""
        return int(np.sum(np.abs(self.predicted) > self.band))


def cumulative_evidence(before: Fit, after: Fit) -> CumulativeEvidence:
    """Cumulative evidence along a log for the fit `after` over the fit `before`."""
    runs = before.log.runs
    valid = np.concatenate([run.valid for run in runs])
    step = np.concatenate([np.append(np.diff(run.time), run.sample_time) for run in runs])
    rise = np.where(valid, _log_likelihoods(after) - _log_likelihoods(before), 0.0)
    return CumulativeEvidence(time=np.cumsum(step) - step[0], evidence=np.cumsum(rise))


def _log_likelihoods(fit: Fit) -> Array:
    """(T,) log-likelihood of each innovation, up to a constant."""
    return np.asarray(-0.5 * (fit.innovations / fit.noise_std) ** 2 - np.log(fit.noise_std))


def residual_over_variable(before: Fit, after: Fit) -> ResidualOverVariable | None:
    """The difference of two fits in the residual torque, over one variable; None if no single variable explains it.

    Also None if the later model does not lower the residual torque: the residual torque is calculated for a rigid
    drivetrain and an ideal sensor, so it does not show compliance or lag in them.
    """
    lacked = residual_torque(before)
    lacks = residual_torque(after, lacked.cutoff)
    if lacks.rms >= lacked.rms:
        return None
    period = _period(before, after)

    def curves(torque: Array) -> list[Curve]:
        once = lacked.folded(period, torque) if period else None
        return [*lacked.curves_of(torque), *([once] if once else [])]

    predicted = curves(lacked.torque - lacks.torque)
    place = int(np.argmax([curve.share for curve in predicted]))
    if predicted[place].share < _TELLING:
        return None
    seen = curves(lacked.torque)[place]
    return ResidualOverVariable(
        variable=seen.variable,
        unit=seen.unit,
        torque_unit=lacked.unit,
        centre=seen.centre,
        before=seen.mean,
        band=seen.band,
        after=curves(lacks.torque)[place].mean,
        predicted=predicted[place].mean,
        share=predicted[place].share,
    )


def _period(before: Fit, after: Fit) -> float | None:
    """Longest period over the angle of the torques that only the later model has; None without any.

    A fine ripple has many periods in an interval of the angle, in which its mean vanishes.
    """
    had = {effect.name for effect in before.model.effects}
    new = [e for e in after.model.effects if e.name not in had and e.curve_over == "angle" and e.stage is Stage.LOAD]
    orders = [order for effect in new for order, *_ in harmonics(effect) if order > 0.0]
    return TURN / min(orders) if orders else None
