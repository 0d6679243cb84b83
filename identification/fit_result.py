"""The result of a fit: values with their uncertainty, and the fit report."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from identification.log import Log
from identification.noise import colour
from identification.prior_knowledge import PriorKnowledge
from plant.drive_train import DriveTrain
from plant.effects.effect import Array
from plant.errors import BadParameter
from plant.model_file import ModelFile
from plant.result_display import Drawn
from plant.servo import ServoModel
from plant.uncertain_number import measured
from plant.units import printed

_ECHO = 1000  # samples of the impulse response of coloured noise


@dataclass(frozen=True, kw_only=True)
class FittedParameter:
    """One line of a fit: `value` and `std` in `unit`; both are None if the data do not determine the parameter.

    A `fixed` parameter without a value was kept at its start, because it is confounded with other parameters.
    """

    name: str
    value: float | None
    std: float | None
    unit: str
    start: float
    fixed: bool = False
    at_bound: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit(Drawn):
    """A fitted model with its uncertainty.

    Attributes:
        model: with the estimates; an undetermined parameter keeps its start, and of confounded parameters their
            well-determined combination is estimated.
        parameters: one line each.
        free: (F,) indices of the fitted parameters.
        covariance: (F, F) of the fitted parameters, with the coloured innovations.
        white_covariance: (F, F) the same for white innovations.
        initial: (R, 2) estimated angle and velocity at the first sample of each run; (R, n) with the departures of the
            other states from where they would be settled, if the log shows these.
        bandwidth: of the observer [rad/s]; 0 if measurement noise alone explains the errors of a free simulation.
        noise_std: standard deviation of the innovations [rad].
        log_likelihood: of the valid samples, less half the prior's squared distance (`identification.prior`).
        samples: number of valid samples.
        innovations: (T,) of all runs, one after another; zero where masked.
        substeps: integration steps in one sample.
        converged: whether the last iteration ended because no further gain was predicted.
        evaluations: passes over the log.
        log: the fitted log.
        known: the user's prior knowledge of the parameters.
        held_log_likelihood: of a chaotic model fitted with an observer that is fast enough to follow the log.
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
    known: PriorKnowledge = field(default_factory=PriorKnowledge)
    held_log_likelihood: float | None = None

    _internal: ClassVar[frozenset[str]] = Drawn._internal | {
        *("evaluations", "free", "held_log_likelihood", "initial", "known", "noise_memory", "runs_off"),
        *("slow_noise", "substeps", "white_covariance"),
    }

    @property
    def unidentifiable(self) -> tuple[str, ...]:
        """Names of the parameters that the data do not determine."""
        return tuple(p.name for p in self.parameters if p.value is None)

    @property
    def fixed(self) -> tuple[str, ...]:
        """Names of the parameters that were not fitted but kept their value."""
        return tuple(p.name for p in self.parameters if p.fixed)

    def initial_of(self, model: ServoModel) -> Array:
        """(R, I) initial states for another model: its states of the same name begin as here, others settled."""
        given = self.model.states[: self.initial.shape[1]]
        if len(given) == 2:
            return self.initial
        found = np.zeros((len(self.initial), len(model.states)))
        for place, state in enumerate(model.states):
            if state in given:
                found[:, place] = self.initial[:, given.index(state)]
        return found

    @property
    def noise_floor(self) -> float:
        """Standard deviation of the measurement noise, with its colour [rad]."""
        return self.noise_std * float(np.sqrt(np.sum(self._noise_echo**2)))

    @property
    def slow_noise(self) -> float:
        """Standard deviation of white noise that is as strong at low frequencies as the measurement noise [rad]."""
        return self.noise_std * float(abs(np.sum(self._noise_echo)))

    @property
    def noise_memory(self) -> float:
        """Time in which the impulse response of the measurement noise falls to a third [s]; 0 if it is white."""
        loud = np.abs(self._noise_echo) > 1.0 / 3.0
        return float((int(np.flatnonzero(loud)[-1]) + 1) * self.log.sample_time) if self.log.colour else 0.0

    @property
    def _noise_echo(self) -> Array:
        """Impulse response of the measurement noise to an innovation."""
        start = np.zeros(_ECHO if self.log.colour else 1)
        start[0] = 1.0
        return colour(start, np.array(self.log.colour))

    @property
    def runs_off(self) -> bool:
        """Whether the motion grows without bound in every attempt to fit the model."""
        return self.log_likelihood == -np.inf

    @property
    def failed(self) -> str | None:
        """Why the fit cannot be used and what to do; None if it can be used, and if the load never moves."""
        if self.runs_off:
            return "the motion of the model grows without bound. Leave out the part of the log where it does."
        if not self.converged:
            return "the iteration stopped before it converged. Start from a model near the machine: --base MODEL.json."
        free = [line for line in self.parameters if not line.fixed]
        undetermined = any(line.value is None for line in free)  # then a value at its bound means nothing
        determined = [line.value is not None and not (line.at_bound and undetermined) for line in free]
        moves = [(run.output - run.output[run.valid].mean())[run.valid] for run in self.log.runs]
        if any(determined) or not determined or np.std(np.concatenate(moves)) <= 2.0 * self.noise_std:
            return None
        return (
            "its parameters do not change how well the motion is explained. "
            "Check that this torque drives this angle: their sign, units and times."
        )

    @property
    def correlation(self) -> NDArray[np.float64]:
        """(F, F) correlation of the fitted parameters."""
        std = np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))
        return np.asarray(self.covariance / np.outer(std, std))

    def model_file(self, gears: DriveTrain | None = None) -> ModelFile:
        """The fitted model with its standard errors, its source files, and the gears for which they were read."""
        return ModelFile(
            model=self.model,
            std={p.name: p.std for p in self.parameters},
            sample_time=self.log.runs[0].sample_time / self.log.decimation,
            gears=gears,
            source=tuple({"file": s.file, "sha256": s.sha256} for s in self.log.sources),
        )

    def save(self, path: Path | str) -> None:
        """Write the model with its standard errors as model.json, which `plant.read_model` and every command read."""
        self.model_file().write(Path(path))

    def __getitem__(self, name: str) -> FittedParameter:
        """The parameter of that name."""
        for p in self.parameters:
            if p.name == name:
                return p
        raise BadParameter(f"The fit has no parameter {name!r}; it has {', '.join(p.name for p in self.parameters)}.")

    def __str__(self) -> str:
        """The report."""
        return fit_report(self)

    def __repr__(self) -> str:
        """Parameters with their values, and the log, in one line."""
        values = ", ".join(f"{p.name}={value:.4g}" for p, value in zip(self.parameters, self.model.values, strict=True))
        return f"Fit({values}; {self.log!r})"


def fit_report(fit: Fit, *, correlated: float = 0.5) -> str:
    """The fit as text: one line per parameter, then the correlations above `correlated`."""
    process = "output error" if fit.bandwidth == 0.0 else f"observer bandwidth {fit.bandwidth:.3g} rad/s"
    process = "inverse model" if fit.log.response == "torque" else process
    lines = [f"Fit of {len(fit.log.runs)} run(s), {fit.samples} samples: {process}"]
    lines += [f"  noise {fit.noise_std:.4g} {fit.log.measured_unit}, log-likelihood {fit.log_likelihood:.1f}", ""]
    width = max(len(p.name) for p in fit.parameters)
    if fit.failed is not None:
        lines += [f"  The fit failed: {fit.failed}", ""]
    lines += [f"  {p.name:<{width}}  {_value(p, fit.failed is not None)}" for p in fit.parameters]
    lines += [f"  {line}" for line in _prior_lines(fit)]
    pairs = correlations(fit, correlated)
    if pairs:
        lines += ["", f"  correlations above {correlated:g}"]
        lines += [f"    {a}, {b}: {r:+.3f}" for a, b, r in pairs]
    return "\n".join(lines)


def _value(p: FittedParameter, failed: bool) -> str:
    if p.fixed and p.value is not None:
        return f"{p.value:.6g} {printed(p.unit)} (fixed)"
    if p.value is None or p.std is None:
        return "not found" if failed else f"cannot be determined from this log (start {p.start:.4g} {printed(p.unit)})"
    share = f" ({100.0 * p.std / abs(p.value):.2g} %)" if p.value else ""
    bound = "  AT BOUND" if p.at_bound else ""
    return f"{measured(p.value, p.std, p.unit)}{share}  from {p.start:.4g}{bound}"


def _prior_lines(fit: Fit) -> list[str]:
    """One line for each prior and for each pair of bounds that the user gave."""
    units = {p.name: printed(p.unit) for p in fit.parameters}
    priors = [f"prior of {n}: {m:g} ± {s:g} {units[n]}" for n, (m, s) in fit.known.prior.items() if n in units]
    bounds = [f"bounds of {n}: {a:g} .. {b:g} {units[n]}" for n, (a, b) in fit.known.bounds.items() if n in units]
    return ["", *priors, *bounds] if priors or bounds else []


def correlations(fit: Fit, above: float) -> list[tuple[str, str, float]]:
    """Pairs of fitted parameters with a correlation above a threshold in magnitude, the largest first."""
    names = [fit.model.names[place] for place in fit.free]
    table = fit.correlation
    pairs = [
        (names[i], names[j], float(table[i, j]))
        for i in range(len(names))
        for j in range(i)
        if abs(table[i, j]) > above and not {names[i], names[j]} & set(fit.unidentifiable)
    ]
    return sorted(pairs, key=lambda pair: -abs(pair[2]))


def fit_to_dict(fit: Fit) -> dict[str, Any]:
    """The content of fit.json."""
    given = {"bounds": fit.known.bounds, "prior": fit.known.prior}
    return {
        "schema": 1,
        "parameters": {
            p.name: {
                "value": p.value,
                "std": p.std,
                "unit": p.unit,
                "start": p.start,
                "fixed": p.fixed,
                "at_bound": p.at_bound,
                "identifiable": p.value is not None,
                **{what: pairs[p.name] for what, pairs in given.items() if p.name in pairs},
            }
            for p in fit.parameters
        },
        "correlations": [{"a": a, "b": b, "correlation": r} for a, b, r in correlations(fit, 0.0)],
        "noise_std": fit.noise_std,
        "observer_bandwidth": fit.bandwidth,
        "log_likelihood": fit.log_likelihood,
        "samples": fit.samples,
        "converged": fit.converged,
        "failed": fit.failed,
        "data": {"warnings": list(fit.log.warnings), "repairs": list(fit.log.repairs), "notes": list(fit.log.notes)},
        "source": [{"file": s.file, "sha256": s.sha256} for s in fit.log.sources],
    }
