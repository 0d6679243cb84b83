"""What a fit found: values with their uncertainty, and what it stands on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.log import Log
from plant.effects.effect import Array
from plant.errors import BadParameter
from plant.servo import ServoModel


@dataclass(frozen=True, kw_only=True)
class FittedParameter:
    """One line of a fit: `value` and `std` in `unit`; both are None where the data cannot tell."""

    name: str
    value: float | None
    std: float | None
    unit: str
    start: float
    fixed: bool = False
    at_bound: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """A fitted model with its uncertainty.

    Attributes:
        model: with the estimates; a parameter that the data cannot tell keeps its start.
        parameters: one line each.
        free: (F,) places of the fitted parameters.
        covariance: (F, F) of the fitted parameters, for innovations of the colour that they have.
        white_covariance: (F, F) the same if the innovations were white.
        initial: (R, 2) estimated angle and velocity at the first sample of each run.
        bandwidth: of the observer [rad/s]; 0 when what the model misses is measurement noise alone.
        noise_std: standard deviation of the innovations [rad].
        log_likelihood: of the valid samples.
        samples: number of valid samples.
        innovations: (T,) of all runs, one after another; zero where masked.
        substeps: integration steps in one sample.
        converged: whether the last iteration ended because nothing was left to gain.
        evaluations: passes over the log.
        log: what was fitted.
    """

    model: ServoModel
    parameters: tuple[FittedParameter, ...]
    free: tuple[int, ...]
    covariance: NDArray[np.float64]
    white_covariance: NDArray[np.float64]
    initial: Array
    bandwidth: float
    noise_std: float
    log_likelihood: float
    samples: int
    innovations: Array
    substeps: int
    converged: bool
    evaluations: int
    log: Log

    @property
    def unidentifiable(self) -> tuple[str, ...]:
        """Names of the parameters that the data cannot tell."""
        return tuple(p.name for p in self.parameters if p.value is None)

    @property
    def correlation(self) -> NDArray[np.float64]:
        """(F, F) correlation of the fitted parameters."""
        std = np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))
        return np.asarray(self.covariance / np.outer(std, std))

    def __getitem__(self, name: str) -> FittedParameter:
        """The parameter of that name."""
        for p in self.parameters:
            if p.name == name:
                return p
        raise BadParameter(f"The fit has no parameter {name!r}; it has {', '.join(p.name for p in self.parameters)}.")

    def __str__(self) -> str:
        """The report."""
        from identification.fit_report import fit_report

        return fit_report(self)
