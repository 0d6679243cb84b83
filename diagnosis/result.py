"""The results of a diagnosis: verdict, causes, the posterior over sets of effects, the gain, and data for plots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from diagnosis.residual_torque import ResidualTorque
from identification.fit_result import Fit
from plant.effects.effect import Array
from plant.servo import ServoModel

SCHEMA = 2
LISTED = 0.01
"""Least probability of a set of effects, or of an alternative to an effect, that is listed."""
Verdict: TypeAlias = Literal["named", "nothing_missing", "unknown", "ambiguous"]


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A number with its standard error (None if unknown) and unit."""

    value: float
    std: float | None
    unit: str


@dataclass(frozen=True, kw_only=True)
class Cause:
    """One reported effect: probable, and larger than the unexplained part.

    Attributes:
        effect: its name in the catalogue.
        probability: posterior probability that it is present and not a part of the unexplained torque.
        alternatives: competing effects of the sets without it, with their probabilities, the most probable first.
        parameters: estimates by parameter name.
        share: of the power of the residual torque without it that it explains, 0 to 1 [-].
        rms: of the torque that it explains along the measured motion [N m].
        gain, gain_std: relative reduction of the validation error by the effect [-], from simulations like those of the
            whole model's gain, and its standard error.
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
    """An effect that is probable by its evidence, but no larger than the unexplained part; attributes as of `Cause`."""

    effect: str
    probability: float
    share: float
    rms: float
    parameters: Mapping[str, Estimate] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class EffectSet:
    """A set of effects.

    Attributes:
        effects: their names, sorted.
        unknown: variables that the unmodelled torque depends on; empty if it is negligible.
        probability: of the set, reduced for effects that are no larger than the unmodelled torque.
        log_marginal: its log marginal likelihood.
        fit: of the model with the set. Both are None if the set was not fitted but is a remainder of a larger one.
    """

    effects: tuple[str, ...]
    unknown: tuple[str, ...]
    probability: float
    log_marginal: float | None
    fit: Fit | None


@dataclass(frozen=True, kw_only=True)
class Unknown:
    """The unexplained part of the log.

    Attributes:
        probability: posterior probability of an unmodelled torque.
        measurement_error: posterior probability of an unmodelled measurement error.
        depends_on: variables of the torque, or of the measurement error if there is no torque.
        share: size of the unmodelled torque divided by that of the whole torque [-].
    """

    probability: float
    measurement_error: float
    depends_on: tuple[str, ...]
    share: float


@dataclass(frozen=True, kw_only=True)
class Rejected:
    """A candidate effect that is not reported, with the most important reason."""

    effect: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class Gain:
    """Error of a free simulation on validation data, in the unit of the output.

    Attributes:
        held_out_rms_before, held_out_rms_after: with the base and the extended model.
        noise_floor: standard deviation of the measurement noise, estimated from the extended model.
        floor_name: name of this value; not "noise floor" if the sampling is irregular or the measured noise is smaller.
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
        """Relative reduction of the error [-]."""
        return 1.0 - self.held_out_rms_after / self.held_out_rms_before if self.held_out_rms_before else 0.0


@dataclass(frozen=True, kw_only=True)
class TorqueError:
    """Relative error of the inverse model, |torque - needed torque| / |torque| [-], after a low pass at `cutoff` [Hz].

    Inverse models are usually published with this figure. It needs no simulation, so it contains no drift. `std` has
    the standard error of each field by its name.
    """

    cutoff: float
    estimation_before: float
    estimation_after: float
    held_out_before: float
    held_out_after: float
    std: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Unexplained:
    """Unexplained share of the validation error power above the noise floor, and the variables it depends on."""

    share: float
    depends_on: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Replay:
    """One run, measured and in free simulation: arrays (T,) [s; rad or m]."""

    label: str
    time: Array
    measured: Array
    before: Array
    after: Array
    valid: NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Findings:
    """The findings of a diagnosis.

    Attributes:
        verdict: "named", "nothing_missing", "ambiguous" or "unknown".
        causes: the reported effects, the largest torque first.
        minor: effects that are probable, but smaller than the unexplained part.
        sets: the joint posterior over sets of effects, the most probable first.
        without: for each effect of the leading set, the fit without the effect; empty if none is probable.
        unknown: the unexplained part, by the likelihood of the log.
        rejected: every other candidate effect, the most probable first.
        gain: on held-out runs.
        torque_error: of the inverse model, before and after, on both parts of the data.
        unexplained: the validation error that remains with the extended model.
        warnings: faults and limits of the data.
        base: fit of the base model to the estimation runs.
        extended: fit of the extended model; the same object as `base` when nothing was added. If no effect is probable,
            it has those of the set with the most evidence if it predicts validation data better with them.
        residual_before, residual_after: residual torque of the base and the extended model, over the estimation runs.
        replays: the held-out runs, measured and simulated.
        whiteness: share of the extended model's innovations that is predictable from their past, 0 if white [-].
        only_in_validation: where the validation data show an error that the estimation data do not; None if nowhere.
        contradicted: what in the validation data contradicts the model, so that no effect is sure; None if nothing.
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
    contradicted: str | None = None

    @property
    def model(self) -> ServoModel:
        """The extended model."""
        return self.extended.model

    @property
    def read_as(self) -> str:
        """Either "command", or "measured": the torque of the log is late, or it was predicted from the motion."""
        return "command" if self.model.lead() is None and self.base.log.response != "torque" else "measured"

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
                    "parameters": _numbers(cause.parameters),
                    "share": cause.share,
                    "rms": cause.rms,
                    "gain": cause.gain,
                }
                for cause in self.causes
            ],
            "minor": [
                {
                    "effect": each.effect,
                    "probability": each.probability,
                    "parameters": _numbers(each.parameters),
                    "share": each.share,
                    "rms": each.rms,
                }
                for each in self.minor
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


def _numbers(parameters: Mapping[str, Estimate]) -> dict[str, dict[str, Any]]:
    return {name: {"value": each.value, "std": each.std, "unit": each.unit} for name, each in parameters.items()}
