"""Linear analysis of the sampled loop: filter, control law, plant, and response to noise and disturbance torques."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
FREQUENCIES = np.union1d(np.geomspace(1e-5, 0.5, 220), np.linspace(0.01, 0.5, 60))
"""Frequency grid of the analysis, in units of the sampling rate."""

_DOUBLINGS = 40
"""Number of doublings, 2^40 samples, after which every filter is stationary."""

Complex = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearPlant:
    """A model linearised at an operating point, see `mpc.prediction.Predictor`.

    Attributes:
        A: (n, n) derivative of the next state by the state; angle and velocity of the load come first.
        B: (n, 2) derivative of the next state by the torque during the sample and the one before it.
        row: (n,) derivative of the measurement by the state.
        late: dead time of the torque in whole samples.
        sample_time: [s].
    """

    A: Array
    B: Array
    row: Array
    late: int
    sample_time: float


def filter_gain(plant: LinearPlant, *, variance: float, kick: float, drift: float) -> Array:
    """(n + 1,) stationary filter gain for state and disturbance torque.

    Args:
        plant: the linear model.
        variance: of the measurement [rad^2].
        kick: standard deviation of the velocity error of the model in a sample [rad/s].
        drift: rate of the random-walk disturbance [N m/sqrt(s)].
    """
    dt, n = plant.sample_time, plant.row.size
    Q = np.zeros((n + 1, n + 1))
    Q[0, 0], Q[1, 1], Q[n, n] = (kick * dt / 2) ** 2, kick**2, drift**2 * dt
    row = np.append(plant.row, 0.0)
    spread = settled(with_disturbance(plant), row, Q / variance)
    return np.asarray(spread @ row / (row @ spread @ row + 1.0))


def settled(F: Array, row: Array, Q: Array) -> Array:
    """(m, m) stationary covariance of a filter before a measurement of unit variance.

    Solves the discrete Riccati equation by the structure-preserving doubling algorithm (Chu, Fan, Lin, Wang 2004),
    faster than a general solver.
    """
    A, G, H, eye = F.T, np.outer(row, row), Q, np.eye(row.size)
    for _ in range(_DOUBLINGS):
        W = np.linalg.inv(eye + G @ H)
        step = A.T @ H @ W @ A
        A, G, H = A @ W @ A, G + A @ W @ G @ A.T, H + step
        if np.max(np.abs(step)) <= 1e-14 * np.max(np.abs(H)):
            break
    return H


def with_disturbance(plant: LinearPlant) -> Array:
    """(n + 1, n + 1) transition matrix of state and disturbance."""
    n = plant.row.size
    F = np.eye(n + 1)
    F[:n, :n], F[:n, n] = plant.A, plant.B.sum(axis=1)
    return F


def law(plant: LinearPlant, horizon: int, rate_weight: float, terminal_weight: Array) -> tuple[Array, float]:
    """The first torque of the program as a linear law, for a zero reference and no active bound.

    Returns:
        (n + 1 + late + 1,) gains for the estimate (z, d) and the torques u[k-1], ..., u[k-late-1]; and the largest
        magnitude of the closed-loop poles with state feedback, below one if the horizon is long enough.
    """
    from scipy.linalg import cho_factor, cho_solve, toeplitz

    n, late = plant.row.size, plant.late
    M = np.eye(n + 2)  # of state, disturbance and last torque; the torque stays constant
    M[:n, :n], M[:n, n], M[:n, n + 1] = plant.A, plant.B.sum(axis=1), plant.B.sum(axis=1)
    G = np.append(plant.B[:, 0], (0.0, 1.0))  # effect of a change of the torque
    reaction, ahead, look = np.empty((horizon, n + 2)), G, np.eye(2, n + 2)
    free = np.empty((horizon, 2, n + 2))
    for k in range(horizon):
        reaction[k] = ahead
        ahead, look = M @ ahead, look @ M
        free[k] = look
    root = np.linalg.cholesky(terminal_weight).T
    answers = np.vstack((toeplitz(reaction[:-1, 0], np.zeros(horizon)), root @ reaction[::-1, :2].T))
    targets = np.vstack((free[:-1, 0], root @ free[-1]))
    normal = answers.T @ answers
    normal.ravel()[:: horizon + 1] += rate_weight
    if not np.isfinite(normal).all():
        raise FloatingPointError("the motion over the horizon overflows")
    first = cho_solve(cho_factor(normal), np.eye(1, horizon)[0])
    change = -(first @ answers.T) @ targets
    closed = np.delete(np.delete(M + np.outer(G, change), n, 0), n, 1)  # without the uncontrollable disturbance
    slowest = float(np.max(np.abs(np.linalg.eigvals(closed))))
    change[n + 1] += 1.0  # the torque is the last one plus its change

    # Express the state at the time when the torque acts by the present estimate and the torques not yet effective.
    if not late:
        return change, slowest
    whole = np.zeros(n + 1 + late + 1)
    F = with_disturbance(plant)
    reach = change[: n + 1]
    whole[n + 1] = change[n + 1]
    for i in range(late):  # torque u[k-1-i] acts during sample late-1-i, and is the previous torque one sample later
        whole[n + 1 + i] += reach[:n] @ plant.B[:, 0]
        whole[n + 2 + i] += reach[:n] @ plant.B[:, 1]
        reach = reach @ F
    whole[: n + 1] = reach
    return whole, slowest


@dataclass(frozen=True, kw_only=True)
class Assessment:
    """Key figures of a loop.

    Attributes:
        peak_sensitivity: max |1/(1 + L)|; inf if the loop is not stable.
        delay_margin: least additional dead time that makes it oscillate [s]; inf if none does.
        chatter: standard deviation of the change of the torque from sample to sample due to noise [N m]: the larger
            value of a moving load and of a load held by friction. A held load does not respond, so its loop is open;
            inf if the controller alone is not stable.
        error: root of the integral of the squared error after a load torque step of 1 N m [rad sqrt(s)].
    """

    peak_sensitivity: float
    delay_margin: float
    chatter: float
    error: float


def assess(plant: LinearPlant, gain: Array, law: tuple[Array, float], noise: float) -> Assessment:
    """Assess the loop of filter and law (its poles are those of both); `noise`: white measurement noise, std [rad]."""
    f, z = FREQUENCIES, np.exp(2j * np.pi * FREQUENCIES)
    turned, controller = responses(plant, gain, law[0], z)
    w, L = 2 * np.pi * f / plant.sample_time, -turned * controller
    S = 1.0 / (1.0 + L)
    crossings = np.flatnonzero(np.diff(np.abs(L) >= 1.0))
    share = np.log(np.abs(L[crossings])) / np.log(np.abs(L[crossings] / L[crossings + 1]))
    lags = np.mod(np.angle(-L), 2 * np.pi)  # phase margin, up to the point -1
    lag, at = (each[crossings] + share * (each[crossings + 1] - each[crossings]) for each in (lags, w))
    change = np.abs(controller * (z - 1.0)) ** 2
    loud = max(np.trapezoid(change * np.abs(S) ** 2, f), np.trapezoid(change, f))
    return Assessment(
        peak_sensitivity=float(np.max(np.abs(S))) if law[1] < 1.0 else np.inf,
        delay_margin=float(np.min(lag / at, initial=np.inf)),
        chatter=float(noise * np.sqrt(2.0 * loud)) if _stable_alone(plant, gain, law[0]) else np.inf,
        error=float(np.sqrt(np.trapezoid(np.abs(turned * S / w) ** 2, w) / np.pi)),
    )


def _stable_alone(plant: LinearPlant, gain: Array, law: Array) -> bool:
    """Whether the controller is stable with a constant measurement, apart from its integrator with a pole at one."""
    poles = np.linalg.eigvals(feedback(plant, gain, law)[0])
    poles[np.argmin(np.abs(poles - 1.0))] = 0.0
    return bool(np.max(np.abs(poles)) < 1.0)


def feedback(plant: LinearPlant, gain: Array, law: Array) -> tuple[Array, Array, Array, Array]:
    """A, B, C and D of the controller from measurement to torque, sign included.

    The state is the last estimate (z, d) and the torques u[k-1], ..., u[k-late-2].
    """
    n, late = plant.row.size, plant.late
    predict = np.zeros((n + 1, n + late + 3))
    predict[:, : n + 1], predict[:n, -2:] = with_disturbance(plant), plant.B
    estimate = predict - np.outer(gain, np.append(plant.row, 0.0) @ predict)
    C = np.zeros((1, n + late + 3))
    C[0] = law[: n + 1] @ estimate
    C[0, n + 1 : -1] += law[n + 1 :]
    D = np.array([[law[: n + 1] @ gain]])
    K, Ky = np.zeros((n + late + 3, n + late + 3)), np.zeros((n + late + 3, 1))
    K[: n + 1], Ky[: n + 1, 0] = estimate, gain
    K[n + 1], Ky[n + 1] = C[0], D[0]
    K[n + 2 :, n + 1 : -1] = np.eye(late + 1)
    return K, Ky, C, D


def responses(plant: LinearPlant, gain: Array, law: Array, z: Complex) -> tuple[Complex, Complex]:
    """(M,) plant (torque to measurement) and controller (measurement to torque, sign included) on the unit circle."""
    n, late = plant.row.size, plant.late
    eye, back = np.eye(n + 1), 1.0 / z
    torque = np.zeros((z.size, n + 1), dtype=complex)
    torque[:, :n] = (plant.B[:, 0] + np.outer(back, plant.B[:, 1])) * (back**late)[:, None]
    moved = np.linalg.solve(z[:, None, None] * np.eye(n) - plant.A, torque[:, :n, None])[..., 0]
    keep = eye - np.outer(gain, np.append(plant.row, 0.0))  # x = keep (F x + torque u)/z + gain y
    settles = np.linalg.inv(eye - back[:, None, None] * (keep @ with_disturbance(plant)))
    known = law[: n + 1] @ settles
    by_torque = np.einsum("mj,mj->m", known @ keep, torque * back[:, None])
    by_torque = by_torque + np.polyval(np.append(law[:n:-1], 0.0), back)
    return moved @ plant.row, (known @ gain) / (1.0 - by_torque)
