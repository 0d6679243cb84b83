"""Bandwidth, horizon and disturbance rate for any machine: as fast as sample time, encoder and dead time allow.

In units of 1/w (w = 2 pi times the bandwidth), of the inertia J and of the encoder's noise the loop of a rigid servo
depends on w Ts alone, so one choice of these three serves a clock's hand and a crane. Its peak sensitivity is 1.6 to
1.75 for a rigid servo, and with the lateness that is admitted below 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plant.effects import ActuatorLag, SensorLag
from plant.servo import ServoModel

OBSERVER, _LATER = 5.0, 28.0
"""Bandwidth of the estimator in units of that of the control law, and by how much it is more for a lateness of 1/w."""

_HORIZON = 0.25
"""Time looked ahead, in periods of the bandwidth: with half of it the loop is all but unstable."""

_LEAST = 10
"""Samples looked ahead at least."""

_PER_SAMPLE = 0.05
"""Of a period of the bandwidth a sample may be: the estimator then moves by about its own time constant."""

_LATE = 0.25
"""Largest lateness of drive and sensor, in units of 1/w."""

_SHARE = 0.125
"""Of the least flank torque, the standard deviation by which the encoder's noise makes the torque change from sample to
sample: swinging teeth need some times that."""

_FLOOR = 1e-3
"""That torque is taken to be no less than this share of the greatest: with no preload nothing is kept together."""

_GAIN = 92.0
"""That deviation for a noise of one, J = 1, w = 1 and Ts = 1: it grows with w^3.5 Ts^1.5 and the estimator's speed."""


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """What a machine allows.

    Attributes:
        bandwidth: w/(2 pi) [Hz].
        horizon: samples looked ahead.
        disturbance_rate: how fast the unknown torque may wander [N m/sqrt(s)].
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
        """For a machine, or also for a bandwidth that is wanted [Hz].

        Args:
            model: inertia and what is late are asked for.
            sample_time: Ts [s].
            noise: standard deviation of the encoder, its steps included [rad].
            least: flank torque that is to be left, seen at the load [N m].
            greatest: torque that the drives together reach in both senses [N m].
        """
        J, late = model.inertia, _lateness(model)
        quiet = max(_SHARE * least, _FLOOR * greatest) / (_GAIN * J * noise * sample_time**1.5)

        def admitted(w: float) -> bool:
            faster = observer(w, late) / OBSERVER
            calm = w**3.5 * faster**2.25 <= quiet
            return calm and w * late <= _LATE and w * sample_time * faster <= 2 * np.pi * _PER_SAMPLE

        if bandwidth is None:
            w, most = 0.0, 2 * np.pi * _PER_SAMPLE / sample_time
            for place in range(1, 40):  # bisection: whatever is slower is admitted too
                tried = w + most / 2**place
                w = tried if admitted(tried) else w
            bandwidth = w / (2 * np.pi)
        w = 2 * np.pi * bandwidth
        return cls(
            bandwidth=bandwidth,
            horizon=max(_LEAST, int(np.ceil(_HORIZON / (bandwidth * sample_time)))),
            disturbance_rate=float(J * (observer(w, late) * w) ** 3 * noise * np.sqrt(sample_time)),
        )


def observer(w: float, late: float) -> float:
    """Bandwidth of the estimator in units of that of the control law, w [1/s], for a lateness [s]."""
    return OBSERVER + _LATER * min(w * late, _LATE)


def _lateness(model: ServoModel) -> float:
    """Dead time and lags of drive and sensor [s]."""
    lags = (effect for effect in model.effects if isinstance(effect, ActuatorLag | SensorLag))
    return float(model.delay()) + sum(effect.time_constant for effect in lags)
