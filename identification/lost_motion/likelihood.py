"""The likelihood of a sweep of the preload, and its maximum.

The unknowns are ten numbers, five per drive: offset, intercepts of loading and unloading, slopes of loading and
unloading, all of the twist over the drive's torque (see `identification.lost_motion.sweep`); and the noise of the
load's encoder.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.checks.faults import quantum
from identification.lost_motion.flank_visits import FlankSamples
from identification.lost_motion.quantised_likelihood import quantised_likelihood

Array = NDArray[np.float64]

_FINE = 0.01  # of the noise: a finer count has no effect by rounding
_NOTHING = 1e-12  # least information; the Gaussian approximation has 1
_FADED = 0.05  # correlation below which residuals count as independent


@dataclass(frozen=True, kw_only=True, eq=False)
class SweepEstimate:
    """The most likely numbers.

    Attributes:
        numbers: (10,).
        covariance: (10, 10); extremely large for numbers that the samples do not determine.
        noise: of the load's angle before quantisation, standard deviation [rad].
    """

    numbers: Array
    covariance: Array
    noise: float


def most_likely(samples: FlankSamples) -> SweepEstimate:
    """Maximum likelihood from samples on both flanks of both drives, loading and unloading."""
    from scipy.optimize import minimize

    sweep = _Sweep(samples)
    found = minimize(
        sweep.value_and_slope,
        np.append(sweep.start, 1.0),
        jac=True,
        hess=sweep.curvature,
        method="trust-exact",
        options={"gtol": 1e-4},
    )
    size, axes = np.linalg.eigh(sweep.curvature(found.x))
    root = sweep.basis @ (axes[:10] / np.sqrt(np.maximum(size, _NOTHING)))
    noise = sweep.noise(float(found.x[10]))[0]
    return SweepEstimate(
        numbers=sweep.basis @ found.x[:10], covariance=sweep.correlation_factor(noise) * root @ root.T, noise=noise
    )


class _Sweep:
    """Minus the log-likelihood in unknowns (10,), scaled to unit covariance in a Gaussian approximation, and noise.

    The difference of the rotor angles is Gaussian. Its residuals are rounding of the motors' encoders and are
    correlated from sample to sample and from visit to visit; so they have the weight of fewer, independent samples. The
    mean of the rotor angles, less half the sum of the twists, is the load's angle; the measurement is that angle
    rounded.
    """

    def __init__(self, samples: FlankSamples) -> None:
        """Scale the problem with its Gaussian approximation."""
        first, second = (_columns(samples, drive) for drive in (0, 1))
        self._apart, self._of_apart = samples.rotors[:, 0] - samples.rotors[:, 1], np.hstack((first, -second))
        self._middle, self._of_middle = samples.rotors.mean(axis=1), 0.5 * np.hstack((first, second))
        self._measured = samples.measured
        left = _left(self._of_apart, self._apart)
        self._correlation = _correlation_factor(left, samples.visit)
        repeated = max(np.unique(samples.visit).size / 2.0, 1.0)  # the visits of a flank may have the same rounding
        spread = float(np.std(left)) * np.sqrt(self._correlation * repeated)
        off = self._middle - self._measured
        self._least_noise = 0.5 * float(np.std(left))  # the motors' share
        self._scale = max(float(np.std(_left(self._of_middle, off))), self._least_noise)
        self._count = max(quantum(samples.measured), _FINE * self._scale)
        stacked = np.vstack((self._of_apart / spread, self._of_middle / self._scale))
        orthogonal, triangle = np.linalg.qr(stacked)
        self.basis = np.linalg.inv(triangle)
        self.start = orthogonal.T @ np.concatenate((self._apart / spread, off / self._scale))
        self._apart, self._of_apart = self._apart / spread, self._of_apart @ self.basis / spread
        self._of_middle = self._of_middle @ self.basis

    def noise(self, unknown: float) -> tuple[float, float, float]:
        """Noise [rad], never below the motors' share, and two derivatives of its logarithm by the unknown."""
        noise = float(np.hypot(self._least_noise, unknown * self._scale))
        by = unknown * (self._scale / noise) ** 2
        return noise, by, (self._scale / noise) ** 2 - 2.0 * by**2

    def correlation_factor(self, noise: float) -> float:
        """Number of load measurements per independent one: the motors' share of their noise is correlated."""
        return 1.0 + (self._least_noise / noise) ** 2 * (self._correlation - 1.0)

    def value_and_slope(self, unknowns: Array) -> tuple[float, Array]:
        """Minus the log-likelihood, and its gradient (11,)."""
        noise, by, _ = self.noise(float(unknowns[10]))
        left = self._apart - self._of_apart @ unknowns[:10]
        expected = self._middle - self._of_middle @ unknowns[:10]
        likelihood = quantised_likelihood(self._measured, expected, count=self._count, noise=noise)
        slope = self._of_middle.T @ likelihood.slope[:, 0] - self._of_apart.T @ left
        value = 0.5 * float(left @ left) - float(np.sum(likelihood.value))
        return value, np.append(slope, -by * np.sum(likelihood.slope[:, 1]))

    def curvature(self, unknowns: Array) -> Array:
        """(11, 11) Hessian."""
        noise, by, twice = self.noise(float(unknowns[10]))
        expected = self._middle - self._of_middle @ unknowns[:10]
        likelihood = quantised_likelihood(self._measured, expected, count=self._count, noise=noise)
        found = np.empty((11, 11))
        of_middle = self._of_middle.T * likelihood.curvature[:, 0, 0] @ self._of_middle
        found[:10, :10] = self._of_apart.T @ self._of_apart - of_middle
        found[:10, 10] = found[10, :10] = by * (self._of_middle.T @ likelihood.curvature[:, 0, 1])
        found[10, 10] = -(by**2) * np.sum(likelihood.curvature[:, 1, 1]) - twice * np.sum(likelihood.slope[:, 1])
        return found


def _columns(samples: FlankSamples, drive: int) -> Array:
    """(N, 5) regressors of a drive's five numbers for its twist."""
    flank, torque = samples.flank[:, drive], samples.torque[:, drive]
    loading = samples.loading[:, drive].astype(np.float64)
    back = 1.0 - loading
    return np.column_stack((np.ones(flank.size), flank * loading, flank * back, torque * loading, torque * back))


def _left(columns: Array, values: Array) -> Array:
    return np.asarray(values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0])


def _correlation_factor(residuals: Array, visit: NDArray[np.int64]) -> float:
    """Number of samples of these residuals (N,) per independent one: 1 + 2 (sum of correlations) within visits."""
    groups = [residuals[visit == number] for number in np.unique(visit)]
    power, factor = float(residuals @ residuals), 1.0
    for lag in range(1, min(map(len, groups))):
        correlation = sum(float(group[lag:] @ group[:-lag]) for group in groups) / power
        if correlation < _FADED:
            break
        factor += 2.0 * correlation
    return factor
