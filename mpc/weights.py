"""The weights of the predictive controller for a given bandwidth of the loop."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mpc.linear_loop import settled
from plant.servo import ServoModel

Array = NDArray[np.float64]


def rate_weight(model: ServoModel, bandwidth: float, sample_time: float) -> float:
    """s/Ts^2, weight of a change of torque from sample to sample [rad^2/(N m)^2].

    s = 1/(w^4 (J^2 w^2 + K^2)) puts the unconstrained poles of the rigid servo on a Butterworth pattern of bandwidth
    w = 2 pi f: of third order where its inertia counts there, of second where its viscous friction does.
    """
    w = 2 * np.pi * bandwidth
    impedance = (model.inertia * w) ** 2 + model.viscous_friction**2
    return float(1.0 / (w**4 * impedance * sample_time**2))


def terminal_weight(model: ServoModel, rate: float, sample_time: float) -> Array:
    """P of the rigid servo for angle and velocity (2, 2), from its Riccati equation, minimised over the last torque."""
    A = _transition(model.inertia, model.viscous_friction, sample_time)
    P = rate * settled(A.T, np.array([A[0, 2], A[1, 2], 1.0]), np.diag([1.0 / rate, 0.0, 0.0]))
    return np.asarray(P[:2, :2] - np.outer(P[:2, 2], P[2, :2]) / P[2, 2])


@lru_cache(maxsize=16)
def _transition(inertia: float, viscous_friction: float, sample_time: float) -> Array:
    """(3, 3) transition matrix of angle, velocity and a constant torque over a sample."""
    from scipy.linalg import expm

    rates = [[0.0, 1.0, 0.0], [0.0, -viscous_friction / inertia, 1.0 / inertia], [0.0, 0.0, 0.0]]
    return np.asarray(expm(sample_time * np.array(rates)))
