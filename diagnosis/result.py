"""What a diagnosis says: verdict, causes, the posterior over sets of effects, the gain, and the pictures' data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from diagnosis.residual_torque import ResidualTorque
from identification.fit_result import Fit
from plant.effects.effect import Array
from plant.servo import ServoModel

SCHEMA = 2
LISTED = 0.01
"""Probability from which a set of effects, or an alternative to an effect, is listed."""
Verdict: TypeAlias = Literal["named", "nothing_missing", "unknown", "ambiguous"]


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A number with its standard error (None where unknown) and unit."""

    value: float
    std: float | None
    unit: str


@dataclass(frozen=True, kw_only=True)
class Cause:
    """One named effect: probable, and larger than what no effect explains.

    Attributes:
        effect: its name in the catalogue.
        probability: that it is there, and is no part of what no effect explains.
        alternatives: what the sets without it have in its place, with their probabilities, the likeliest first.
        parameters: estimates by parameter name.
        share: of the power of the residual torque without it that it explains, 0 to 1 [-].
        rms: of the torque that it explains along the measured motion [N m].
        gain: share by which the error of multi-step prediction on validation data is smaller with it than without [-],
            and gain_std its standard error.
        log_bayes: log marginal likelihood of the best set with it less that of the best set without it.
    """

    effect: str
    probability: float
    alternatives: tuple[tuple[str, float], ...]
    parameters: Mapping[str, Estimate]
    share: float
    rms: float
    gain: float
    gain_std: float
    log_bayes: float


@dataclass(frozen=True, kw_only=True)
class Minor:
    """An effect that is probable by its evidence, but no larger than what no effect explains; else as a cause."""

    effect: str
    probability: float
    share: float
    rms: float


@dataclass(frozen=True, kw_only=True, eq=False)
class EffectSet:
    """Effects that explain the log together.

    Attributes:
        effects: their names, sorted.
        unknown: what the unmodelled torque beside them depends on; empty where there is none to speak of.
        probability: of the set; what is no larger than the unmodelled torque counts for less.
        log_marginal: its log marginal likelihood.
        fit: of the model with all of them. Both are None where the set is only what may remain of a larger one.
    """

    effects: tuple[str, ...]
    unknown: tuple[str, ...]
    probability: float
    log_marginal: float | None
    fit: Fit | None


@dataclass(frozen=True, kw_only=True)
class Unknown:
    """What no effect explains.

    Attributes:
        probability: that there is an unmodelled torque.
        measurement_error: probability that there is an unmodelled error of the measurement.
        depends_on: variables of the torque; of the error, where there is no torque.
        share: size of the torque over that of all torque [-].
    """

    probability: float
    measurement_error: float
    depends_on: tuple[str, ...]
    share: float


@dataclass(frozen=True, kw_only=True)
class Rejected:
    """An effect that was tried and is not named, and the one reason that weighs most."""

    effect: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class Gain:
    """Held-out error of a free simulation, in the unit of the output.

    Attributes:
        held_out_rms_before, held_out_rms_after: with the base and the extended model.
        noise_floor: standard deviation of the measurement noise, as far as the data tell.
        floor_name: what that is, where the times are irregular or the readings are quieter: then it is no noise floor.
        unit: "rad" or "m".
        window: seconds after which the simulation restarts; None for a simulation through whole runs.
        runs: labels of the held-out runs.
    """

    held_out_rms_before: float
    held_out_rms_after: float
    noise_floor: float
    unit: str
    window: float | None
    runs: tuple[str, ...]
    floor_name: str = "noise floor"

    @property
    def cut(self) -> float:
        """Share of the error that went away [-]."""
        return 1.0 - self.held_out_rms_after / self.held_out_rms_before if self.held_out_rms_before else 0.0


@dataclass(frozen=True, kw_only=True)
class TorqueError:
    """Relative error of the inverse model, |torque - needed torque| / |torque| [-], behind a low pass at `cutoff` [Hz].

    It is the figure in which inverse models are published; it needs no simulation and so knows no drift. `std` has the
    standard error of each by its name.
    """

    cutoff: float
    estimation_before: float
    estimation_after: float
    held_out_before: float
    held_out_after: float
    std: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Unexplained:
    """What remains: share of the held-out error power above the noise floor, and the variables it depends on."""

    share: float
    depends_on: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Replay:
    """One run measured and simulated freely: arrays (T,) [s; rad or m]."""

    label: str
    time: Array
    measured: Array
    before: Array
    after: Array
    valid: NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Findings:
    """What a diagnosis has found.

    Attributes:
        verdict: "named", "nothing_missing", "ambiguous" or "unknown".
        causes: what the verdict stands on, the largest torque first.
        minor: effects that are probable, but smaller than what no effect explains.
        sets: the joint posterior over sets of effects, the likeliest first.
        without: for each effect of the extended model, the fit of that model less the effect.
        unknown: what no effect explains, by the likelihood of the log.
        rejected: every other effect that was tried, the likeliest first.
        gain: on held-out runs.
        torque_error: of the inverse model, before and after, on both parts of the data.
        unexplained: what remains after the causes.
        warnings: faults and limits of the data.
        base: fit of the base model to the estimation runs.
        extended: fit of the extended model; the same object as `base` when nothing was added.
        residual_before, residual_after: the torque that each of the two models lacks, over the estimation runs.
        replays: the held-out runs.
        whiteness: share of the extended model's innovations that are still predictable from their own past [-].
        only_in_validation: where the validation data show an error that the estimation data do not; None if nowhere.
    """

    verdict: Verdict
    causes: tuple[Cause, ...]
    minor: tuple[Minor, ...]
    sets: tuple[EffectSet, ...]
    without: Mapping[str, Fit]
    unknown: Unknown
    rejected: tuple[Rejected, ...]
    gain: Gain
    torque_error: TorqueError
    unexplained: Unexplained
    warnings: tuple[str, ...]
    base: Fit
    extended: Fit
    residual_before: ResidualTorque
    residual_after: ResidualTorque
    replays: tuple[Replay, ...]
    whiteness: float
    only_in_validation: str | None = None

    @property
    def model(self) -> ServoModel:
        """The extended model."""
        return self.extended.model

    @property
    def read_as(self) -> str:
        """Whether the torque of the log is a command, or was "measured" and shows late what acts."""
        return "command" if self.model.lead() is None else "measured"

    def to_dict(self) -> dict[str, Any]:
        """The content of diagnosis.json."""
        return {
            "schema": SCHEMA,
            "verdict": self.verdict,
            "causes": [
                {
                    "effect": cause.effect,
                    "probability": cause.probability,
                    "alternatives": [{"effect": name, "probability": p} for name, p in cause.alternatives],
                    "parameters": {
                        name: {"value": e.value, "std": e.std, "unit": e.unit} for name, e in cause.parameters.items()
                    },
                    "share": cause.share,
                    "rms": cause.rms,
                    "gain": cause.gain,
                }
                for cause in self.causes
            ],
            "minor": [
                {"effect": m.effect, "probability": m.probability, "share": m.share, "rms": m.rms} for m in self.minor
            ],
            "sets": [
                {"effects": list(s.effects), "unknown": list(s.unknown), "probability": s.probability}
                for s in self.sets
                if s.probability >= LISTED
            ],
            "unknown": {
                "probability": max(self.unknown.probability, self.unknown.measurement_error),
                "depends_on": list(self.unknown.depends_on),
                "share": self.unknown.share,
            },
            "rejected": [{"effect": r.effect, "reason": r.reason} for r in self.rejected],
            "gain": {
                "held_out_rms_before": self.gain.held_out_rms_before,
                "held_out_rms_after": self.gain.held_out_rms_after,
                "noise_floor": self.gain.noise_floor,
                "unit": self.gain.unit,
                "window": self.gain.window,
                "runs": list(self.gain.runs),
            },
            "unexplained": {
                "share": self.unexplained.share,
                "depends_on": list(self.unexplained.depends_on),
            },
            "torque_error": {
                "cutoff": self.torque_error.cutoff,
                "estimation_before": self.torque_error.estimation_before,
                "estimation_after": self.torque_error.estimation_after,
                "held_out_before": self.torque_error.held_out_before,
                "held_out_after": self.torque_error.held_out_after,
            },
            "data": {"warnings": list(self.warnings), "read_as": self.read_as},
            "separating_experiment": None,
        }
