"""Automatic choice of bandwidth, horizon and disturbance rate: the fastest disturbance rejection with safe margins.

The bandwidths of control law and filter are chosen together: least squared error after a step of the load torque, with
a peak sensitivity of at most two, a delay margin of at least one sample, and a limit on the torque changes due to
encoder noise. The reference has a feedforward (`mpc.feed_forward`), so a slower loop does not degrade tracking.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mpc.linear_loop import Assessment, LinearPlant, assess, filter_gain, law
from mpc.prediction import Predictor
from mpc.weights import rate_weight, terminal_weight
from plant.effects import SensorLag
from plant.servo import ServoModel
from plant.simulation import whole_samples

_HORIZON = 0.25
"""Horizon, in periods of the bandwidth: with half of it the loop is almost unstable."""

_LEAST = 10
"""Shortest horizon in samples."""

_PEAK = 1.98
"""Largest peak sensitivity on the frequency grid, so that the true peak is at most two."""

_SHARE = 0.125
"""Standard deviation of the torque change per sample due to encoder noise, as a share of the minimum contact torque: an
oscillation of the gear contact has several times this amplitude."""

_FLOOR = 1e-3
"""Lower limit of that standard deviation, as a share of the greatest torque, used without preload."""

_FASTEST, _SLOWEST = 0.2 * np.pi, 0.004
"""Range of the bandwidth of the law, as the angle w Ts."""

_FILTERS = (4.0, 32.0)
"""Range of the filter bandwidth, in units of that of the law: below it the peak sensitivity is above two for any
bandwidth of the law. If the bandwidth is given, half of the lower limit is also tried."""


_UNSTABLE = 1e9
"""Largest ratio to an allowed value: the search needs finite numbers."""

_FINE = 0.01
"""Relative error of the bandwidth in the search, and a tenth of that of the filter bandwidth: the optimum is flat."""


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """The tuning for a machine.

    Attributes:
        bandwidth: w/(2 pi) [Hz].
        horizon: N [samples].
        disturbance_rate: rate of the random-walk disturbance [N m/sqrt(s)].
    """

    bandwidth: float
    horizon: int
    disturbance_rate: float

    @classmethod
    def of(
        cls,
        model: ServoModel,
        *,
        sample_time: float,
        noise: float,
        least: float,
        greatest: float,
        bandwidth: float | None = None,
    ) -> Tuning:
        """The tuning for a machine, optionally for a given bandwidth [Hz].

        If the given bandwidth is too high for the machine, the limit of torque changes has priority over the margins.

        Args:
            model: its inertia, viscous friction, dead times and lags are used.
            sample_time: Ts [s].
            noise: standard deviation of the encoder, its steps included [rad].
            least: minimum contact torque, at the load [N m].
            greatest: torque that the drives together reach in both directions [N m].
        """
        w, observer = _chosen(_linear(model), sample_time, noise, quiet(least, greatest), bandwidth)
        return cls(
            bandwidth=bandwidth or w / (2 * np.pi),
            horizon=_horizon(w, sample_time),
            disturbance_rate=disturbance_rate(model.inertia, observer, noise, sample_time),
        )


def quiet(least: float, greatest: float) -> float:
    """Permitted standard deviation of the torque change from sample to sample [N m], see `Tuning.of`."""
    return max(_SHARE * least, _FLOOR * greatest)


def disturbance_rate(inertia: float, observer: float, noise: float, sample_time: float) -> float:
    """Rate of the random-walk disturbance [N m/sqrt(s)] for a filter of bandwidth `observer` [1/s]."""
    return float(inertia * observer**3 * noise * np.sqrt(sample_time))


def observer_rate(inertia: float, disturbance_rate: float, noise: float, sample_time: float) -> float:
    """Filter bandwidth [1/s] for a rate of the disturbance: the inverse of `disturbance_rate`."""
    return float(np.cbrt(disturbance_rate / (inertia * noise * np.sqrt(sample_time))))


def _linear(model: ServoModel) -> ServoModel:
    """The model with inertia, viscous friction, dead times and lags only."""
    late = tuple(e for e in model.effects if e.delay() or e.lateness() or isinstance(e, SensorLag))
    return ServoModel(
        inertia=model.inertia, gravity=0.0, viscous_friction=model.viscous_friction, effects=late, axis=model.axis
    )


def _horizon(w: float, sample_time: float) -> int:
    return max(_LEAST, int(np.ceil(2 * np.pi * _HORIZON / (w * sample_time) - 1e-9)))


@lru_cache(maxsize=256)
def _chosen(
    model: ServoModel, sample_time: float, noise: float, chatter: float, bandwidth: float | None
) -> tuple[float, float]:
    """Bandwidths of law and filter [1/s]; `chatter`: permitted std of the torque change per sample [N m]."""
    from scipy.optimize import brentq, minimize_scalar

    loop = _family(model, sample_time, noise)
    slowest, most = np.log(np.array((_SLOWEST, _FASTEST)) / sample_time)
    log_bandwidth = None if bandwidth is None else float(np.log(2 * np.pi * bandwidth))

    def excess_peak(log_w: float, log_ratio: float) -> float:
        found = loop(np.exp(log_w), np.exp(log_ratio))
        peak = np.log(found.peak_sensitivity / _PEAK)
        return float(max(peak, np.log(found.chatter / chatter), -np.log(found.delay_margin / sample_time)))

    def fastest(log_ratio: float) -> float:
        low = most
        while excess_peak(low, log_ratio) > 0 and low > slowest:
            low -= np.log(2.0)
        if low == most or low <= slowest:
            return float(max(low, slowest))
        return float(brentq(excess_peak, low, low + np.log(2.0), (log_ratio,), xtol=_FINE)) - _FINE

    def slowness(log_ratio: float) -> float:
        if log_bandwidth is None:
            return float(np.log(loop(np.exp(fastest(log_ratio)), np.exp(log_ratio)).error))
        found = loop(np.exp(log_bandwidth), np.exp(log_ratio))
        beyond = (found.chatter / chatter, found.peak_sensitivity / _PEAK)
        loud, peaked = (np.log(min(ratio, _UNSTABLE)) for ratio in beyond)
        return float(np.log(found.error) + 1e4 * max(loud, 0) + 1e2 * max(peaked, 0))

    ratios = np.log(_FILTERS if log_bandwidth is None else (_FILTERS[0] / 2, _FILTERS[1])).tolist()
    best = minimize_scalar(slowness, bounds=(ratios[0], ratios[1]), method="bounded", options={"xatol": 10 * _FINE})
    w = float(np.exp(fastest(best.x) if log_bandwidth is None else log_bandwidth))
    return w, w * float(np.exp(best.x))


def _family(model: ServoModel, sample_time: float, noise: float) -> Callable[[float, float], Assessment]:
    """The key figures of the loop as a function of law bandwidth [1/s] and ratio of filter to law bandwidth."""
    late, switch = whole_samples(float(model.delay()), sample_time)
    predictor = Predictor(model=model, sample_time=sample_time, switch=max(switch, 0.0))
    still, p = np.zeros(len(model.states)), predictor.parameters
    _, A, B = predictor.stage(still, np.zeros(2), p)
    row = np.asarray(predictor.sensor(still, p)[1])[:, 0]
    plant = LinearPlant(A=np.array(A), B=np.array(B), row=row, late=late, sample_time=sample_time)

    def loop(w: float, ratio: float) -> Assessment:
        rate = rate_weight(model, w / (2 * np.pi), sample_time)
        drift = disturbance_rate(model.inertia, ratio * w, noise, sample_time)
        gain = filter_gain(plant, variance=noise**2, kick=0.0, drift=drift)
        terminal = terminal_weight(model, rate, sample_time)
        return assess(plant, gain, law(plant, _horizon(w, sample_time), rate, terminal), noise)

    return loop
