"""Diagnosis: which physical effect a model lacks, with its posterior probability and the gain on validation data."""

from __future__ import annotations

from diagnosis.batch import diagnose_all
from diagnosis.diagnose import diagnose
from diagnosis.diagnosis import Diagnosis
from diagnosis.experiment import Experiment, Limits, competing_fits, separating_experiment
from diagnosis.explanation import Explanation
from diagnosis.identifiability import identifiability_warnings, standstill
from diagnosis.inverse_model import torque_follows, unexplained_torque
from diagnosis.result import Cause, EffectSet, Findings, Gain, Minor, Rejected, Unknown

__all__ = [
    "Cause",
    "Diagnosis",
    "EffectSet",
    "Experiment",
    "Explanation",
    "Findings",
    "Gain",
    "Limits",
    "Minor",
    "Rejected",
    "Unknown",
    "competing_fits",
    "diagnose",
    "diagnose_all",
    "identifiability_warnings",
    "separating_experiment",
    "standstill",
    "torque_follows",
    "unexplained_torque",
]


def __dir__() -> list[str]:
    return [*__all__]
