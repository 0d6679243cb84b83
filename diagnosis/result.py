"""What a diagnosis says: verdict, causes with their odds, the gain, and the pictures' data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from diagnosis.residual_torque import ResidualTorque
from identification.fit_result import Fit
from plant.effects.effect import Array, Effect
from plant.servo import ServoModel

SCHEMA = 2
LISTED = 0.01
"""Probability from which a set of effects is listed."""
MENTIONED = 1e-4
"""... and an alternative to an effect."""
Verdict: TypeAlias = Literal["named", "nothing_missing", "unknown", "ambiguous"]


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A number with its standard error (None where unknown) and unit."""

    value: float
    std: float | None
    unit: str


@dataclass(frozen=True, kw_only=True)
class Cause:
    """One named effect.

    Attributes:
        effect: its name in the catalogue.
        probability: that this effect, and not one of the alternatives or none, is what the data show.
        alternatives: the rivals with their probabilities, the likeliest first.
        parameters: estimates by parameter name.
        gain: share by which the held-out error fell when the effect was added [-], and gain_std its standard error.
        evidence: rise of the log-likelihood when the effect was added.
        rms: of the torque that it explains along the measured motion [N m].
        share: of the power of the residual torque without it that it explains, 0 to 1 [-].
    """

    effect: str
    probability: float
    alternatives: tuple[tuple[str, float], ...]
    parameters: Mapping[str, Estimate]
    gain: float
    evidence: float
    gain_std: float = 0.0
    rms: float = 0.0
    share: float = 0.0

    @property
    def missing(self) -> float:
        """Probability that it or one of the alternatives is there, and not nothing [-]."""
        return min(self.probability + sum(share for _, share in self.alternatives), 1.0)


@dataclass(frozen=True, kw_only=True)
class Minor:
    """An effect that is probable by its evidence, but smaller than what no effect explains; else as a cause."""

    effect: str
    probability: float
    share: float
    rms: float


@dataclass(frozen=True, kw_only=True)
class EffectSet:
    """Effects that explain the log together, what the discrepancy beside them depends on, and their probability."""

    effects: tuple[str, ...]
    unknown: tuple[str, ...]
    probability: float


@dataclass(frozen=True, kw_only=True)
class Unknown:
    """The unmodelled torque: probability that it is not nothing, its variables, and its size over all torque [-].

    Probability and size are None where the log was not asked for them (`diagnosis.grading`).
    """

    probability: float | None
    depends_on: tuple[str, ...]
    share: float | None

    def likelier_than(self, probability: float) -> bool:
        """Whether it is known to be likelier than that."""
        return self.probability is not None and self.probability > probability


@dataclass(frozen=True, kw_only=True)
class Gain:
    """Held-out error of a free simulation, in the unit of the output.

    Attributes:
        held_out_rms_before, held_out_rms_after: with the base and the extended model.
        noise_floor: standard deviation of the measurement noise, as far as the data tell.
        floor_name: what that is, where the times are uneven or the readings are quieter: then it is no noise floor.
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


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One effect that was tried in one round of the search.

    `evidence` is the rise in log-likelihood; `score` and `visible` are the same less the charge for parameters and
    search, in the questions which name it is and whether anything is missing (see `diagnosis.model_probability`);
    `refitted` is False where the score test alone has judged, and `plausible` where the fitted values are such as its
    cause hardly ever has, for which it pays. `fitted` is the effect as it was fitted, None where only the score test
    has judged.
    """

    round: int
    effect: str
    evidence: float
    score: float
    visible: float
    probability: float
    refitted: bool
    parameters: Mapping[str, Estimate]
    plausible: bool = True
    fitted: Effect | None = None


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
        causes: what the verdict stands on, the most important first.
        minor: effects that are probable, but smaller than what no effect explains.
        sets: the joint posterior over sets of effects, the likeliest first.
        unknown: what no effect explains, by the likelihood of the log.
        gain: on held-out runs.
        torque_error: of the inverse model, before and after, on both parts of the data.
        unexplained: what remains after the causes.
        warnings: faults and limits of the data.
        base: fit of the base model to the estimation runs.
        extended: fit of the extended model; the same object as `base` when nothing was added.
        residual_before, residual_after: the torque that each of the two models lacks, over the estimation runs.
        candidates: everything that was tried.
        replays: the held-out runs.
        whiteness: share of the extended model's innovations that are still predictable from their own past [-].
    """

    verdict: Verdict
    causes: tuple[Cause, ...]
    minor: tuple[Minor, ...]
    sets: tuple[EffectSet, ...]
    unknown: Unknown
    gain: Gain
    torque_error: TorqueError
    unexplained: Unexplained
    warnings: tuple[str, ...]
    base: Fit
    extended: Fit
    residual_before: ResidualTorque
    residual_after: ResidualTorque
    candidates: tuple[Candidate, ...]
    replays: tuple[Replay, ...]
    whiteness: float

    @property
    def model(self) -> ServoModel:
        """The extended model."""
        return self.extended.model

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
            ],
            "unknown": {
                "probability": self.unknown.probability,
                "depends_on": list(self.unknown.depends_on),
                "share": self.unknown.share,
            },
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
            "data": {"warnings": list(self.warnings), "read_as": "command"},
            "separating_experiment": None,
        }
