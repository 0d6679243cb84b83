"""The separating experiment: a torque signal, within the limits of the machine, that distinguishes two models."""

from __future__ import annotations

from diagnosis.experiment.separating import Experiment, competing_fits, separating_experiment
from diagnosis.experiment.signal_design import Limits

__all__ = ["Experiment", "Limits", "competing_fits", "separating_experiment"]
