"""The discrepancy: unmodelled torque and measurement error, with an amplitude that is estimated from the log.

    e = J (theta - theta_0) + D f + noise,    f ~ N(0, a^2)                (linearised innovations)

with e the innovations of a fitted model, J their Jacobian, D the response of the families. Every set of effects
includes it. Marginalised over f, the covariance of the innovations is s^2 I + a^2 D D'.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from diagnosis.evidence.families import Families
from diagnosis.levels import INEXACT
from diagnosis.linear import Filter, response
from diagnosis.nuisance import Nuisance
from plant.effects.effect import Array

AMPLITUDES = (0.0, 1e-3, 3e-3, 1e-2, 3e-2, 0.1)  # of the torque in the log
_ERRORS = (0.0, 0.3, 1.0)  # errors of the measurement, as a share of its noise
_ALONE = (1.0, 3.0)  # factors on the prior standard deviation: one variable alone may need a larger one
_PASSES = 4  # iterations between noise variance and discrepancy


@dataclass(frozen=True, kw_only=True, eq=False)
class Posterior:
    """Posterior of the discrepancy for one set of effects.

    Attributes:
        log_likelihood: of the innovations, marginalised over f and the amplitudes.
        variance: s^2 of the noise at the most probable amplitudes [rad^2].
        amplitude: posterior mean, as a share of the torque in the log [-].
        material: posterior probability that the unmodelled torque is not zero [-].
        measurement_error: posterior probability that the measurement error is not zero [-].
        likeliest: indices of the most probable amplitudes, in `AMPLITUDES` and in `_ERRORS`.
        functions: (M + R,) mean of f there.
        weights: (M + R, M + R) W; the inverse of the covariance is (I - D W D') / s^2.
        scale: (M + R,) prior standard deviations of f there.
    """

    log_likelihood: float
    variance: float
    amplitude: float
    material: float
    measurement_error: float
    likeliest: tuple[int, int]
    functions: Array
    weights: Array
    scale: Array

    @property
    def something(self) -> float:
        """The larger of the two probabilities [-]."""
        return max(self.material, self.measurement_error)

    @property
    def at_its_limit(self) -> bool:
        """Whether the largest amplitude is the most probable: then the fit has failed; its Jacobian says little."""
        return self.likeliest[0] == len(AMPLITUDES) - 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Responses:
    """Response of the innovations of a fit to the functions of the families.

    Attributes:
        columns: (T, M + R) response to unit coefficients; torques first.
        torques: M.
        variables: (M + R,) the variable of each function.
    """

    columns: Array
    torques: int
    variables: tuple[str, ...]

    @classmethod
    def of(cls, families: Families, filters: tuple[Filter, ...], noise: float) -> Responses:
        """Response through the predictor of each run; measurement errors are scaled by `noise` [rad]."""
        on_torque = response(filters, families.torque, on_measurement=False)
        on_measurement = response(filters, noise * families.measurement, on_measurement=True)
        columns = np.hstack((on_torque, on_measurement))
        np.negative(columns, out=columns)
        return cls(
            columns=columns,
            torques=on_torque.shape[1],
            variables=families.variables,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Discrepancy(Nuisance):
    """The directions of parameters and initial states, and the response of the families beyond these.

    Attributes:
        columns: (T, M + R) response of the families to unit coefficients, beyond the parameters.
        torques: M, how many of them are torques; the others are errors of the measurement.
        variables: (M + R,) the variable of each function.
        left: (T,) innovations beyond the parameters.
        degrees: degrees of freedom of `left`.
        posterior: of the families' coefficients.
    """

    columns: Array
    torques: int
    variables: tuple[str, ...]
    left: Array
    degrees: int
    posterior: Posterior

    @classmethod
    def learned(cls, nuisance: Nuisance, responses: Responses, innovations: Array, samples: int) -> Discrepancy:
        """Estimate the discrepancy from the innovations (T,) of a fit."""
        columns, left = nuisance.beyond(responses.columns), nuisance.beyond(innovations)
        degrees = samples - sum(part.shape[1] for part in nuisance.own) - nuisance.shared.shape[1]
        return cls(
            own=nuisance.own,
            shared=nuisance.shared,
            columns=columns,
            torques=responses.torques,
            variables=responses.variables,
            left=left,
            degrees=degrees,
            posterior=_learned(columns.T @ columns, columns.T @ left, float(left @ left), degrees, responses.torques),
        )

    def _information(self, columns: Array, values: Array) -> tuple[Array, Array]:
        found, pull = super()._information(columns, values)
        shared = self.columns.T @ columns
        return found - shared.T @ self.posterior.weights @ shared, pull

    def beyond(self, values: Array) -> Array:
        """Values (T,) or (T, M) beyond the parameters, weighted by the inverse covariance times s^2."""
        left = super().beyond(values)
        return np.asarray(left - self.columns @ (self.posterior.weights @ (self.columns.T @ left)))

    def views(self) -> Iterator[tuple[float, Array]]:
        """Log-likelihood and (M + R, M + R) W of the most probable discrepancy, then of smaller ones, down to zero."""
        torque, measurement = self.posterior.likeliest
        lower = max(torque - 1, 0), max(measurement - 1, 0)
        gram, pull, power = self.columns.T @ self.columns, self.columns.T @ self.left, float(self.left @ self.left)
        for place in dict.fromkeys(((torque, measurement), (torque, 0), lower, (0, 0))):
            scale = _scale(*place, len(pull), self.torques)
            likelihood, _, _, weights = _at(gram, pull, power, self.degrees, scale)
            yield likelihood, weights

    def explained_by(self, beside: Collection[str] = ()) -> dict[str, float]:
        """Gain in log-likelihood by the functions of each variable, as a share of the gain by all [-].

        Torques only, or measurement errors only if the most probable torque is zero. Each variable is taken alone, or
        in addition to the variables in `beside`. Empty if there is no gain.
        """
        gram, pull, power = self.columns.T @ self.columns, self.columns.T @ self.left, float(self.left @ self.left)
        of_torque = np.arange(len(pull)) < self.torques
        of_this_kind = of_torque if self.posterior.likeliest[0] else ~of_torque
        depends_on = np.array(self.variables)

        def evidence(of: NDArray[np.bool_]) -> float:
            scales = (times * of * self.posterior.scale for times in _ALONE)
            return max(_at(gram, pull, power, self.degrees, scale)[0] for scale in scales)

        nothing, everything = evidence(np.zeros_like(of_this_kind)), evidence(of_this_kind)
        if everything <= nothing:
            return {}
        known = of_this_kind & np.isin(depends_on, list(beside))
        before = evidence(known) if beside else nothing
        return {
            variable: (evidence(known | of_this_kind & (depends_on == variable)) - before) / (everything - nothing)
            for variable in dict.fromkeys(depends_on[of_this_kind].tolist())
            if variable not in beside
        }


def _learned(gram: Array, pull: Array, power: float, degrees: int, torques: int) -> Posterior:
    """The posterior from D'D, D'e and e'e, all beyond the parameters."""
    places = list(product(range(len(AMPLITUDES)), range(len(_ERRORS))))
    scales = [_scale(*place, len(pull), torques) for place in places]
    axes: dict[bytes, _Axes] = {}  # amplitudes in the same ratio share them
    tried = []
    for scale in scales:
        size = float(scale.max(initial=0.0)) or 1.0
        ratio = np.round(scale / size, 12)
        if (key := ratio.tobytes()) not in axes:
            axes[key] = _Axes.of(gram, pull, ratio)
        tried.append(axes[key].at(size, power, degrees))
    amplitudes, errors = (np.array(sizes) for sizes in zip(*product(AMPLITUDES, _ERRORS), strict=True))
    scores = np.array([likelihood for likelihood, *_ in tried]) - np.log1p((amplitudes / INEXACT) ** 2)
    best = int(np.argmax(scores))
    weights = np.exp(scores - scores[best])
    _, variance, functions, inverse = tried[best]
    return Posterior(
        log_likelihood=float(scores[best] + np.log(np.mean(weights))),
        variance=variance,
        amplitude=float(weights @ amplitudes / weights.sum()),
        material=_material(weights, amplitudes),
        measurement_error=_material(weights, errors),
        likeliest=places[best],
        functions=functions,
        weights=inverse,
        scale=scales[best],
    )


def _material(weights: Array, sizes: Array) -> float:
    """Posterior probability that a size is not zero; the prior probability is one half."""
    some, none = float(np.mean(weights[sizes > 0.0])), float(np.mean(weights[sizes == 0.0]))
    return some / (some + none)


def _scale(torque: int, measurement: int, columns: int, torques: int) -> Array:
    """(M + R,) standard deviations of the coefficients, torques first."""
    return np.where(np.arange(columns) < torques, AMPLITUDES[torque], _ERRORS[measurement])


def _at(gram: Array, pull: Array, power: float, degrees: int, scale: Array) -> tuple[float, float, Array, Array]:
    """Log-likelihood, s^2, mean of f and W at prior standard deviations (M,) of f."""
    return _Axes.of(gram, pull, scale).at(1.0, power, degrees)


@dataclass(frozen=True, eq=False)
class _Axes:
    """Principal axes of the response to functions whose prior standard deviations have given ratios.

    Attributes:
        values: (K,) eigenvalues.
        along: (K,) D'e along the axes.
        basis: (M, K) coefficients of the functions.
    """

    values: Array
    along: Array
    basis: Array

    @classmethod
    def of(cls, gram: Array, pull: Array, ratio: Array) -> _Axes:
        there = np.flatnonzero(ratio)  # a function without amplitude is left out
        some = ratio[there]
        values, vectors = np.linalg.eigh(some[:, None] * gram[np.ix_(there, there)] * some)
        basis = np.zeros((ratio.size, there.size))
        basis[there] = some[:, None] * vectors
        return cls(np.maximum(values, 0.0), vectors.T @ (some * pull[there]), basis)

    def at(self, size: float, power: float, degrees: int) -> tuple[float, float, Array, Array]:
        """Log-likelihood, s^2, mean of f and W, with `size` times these standard deviations."""
        values, along = size**2 * self.values, size * self.along
        variance = power / degrees
        for _ in range(_PASSES):
            mean = along / (values + variance)
            left = power - float(along @ mean) - variance * float(mean @ mean)
            used = float(np.sum(values / (values + variance)))
            variance = max(left / max(degrees - used, 1.0), 1e-12 * power / degrees)
        stiff = values + variance
        quadratic = power - float(along @ (along / stiff))
        if quadratic <= 0.0:  # only rounding errors are left
            count = len(self.basis)
            return -np.inf, variance, np.zeros(count), np.zeros((count, count))
        log_determinant = float(np.sum(np.log(stiff / variance)))
        likelihood = -0.5 * (degrees * np.log(2.0 * np.pi * variance) + quadratic / variance + log_determinant)
        basis = size * self.basis
        return float(likelihood), variance, basis @ (along / stiff), (basis / stiff) @ basis.T
