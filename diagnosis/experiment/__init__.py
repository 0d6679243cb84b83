"""The experiment that tells two rivals apart: designed within the machine's limits, and shown to do so beforehand."""

from __future__ import annotations

from diagnosis.experiment.separating import Experiment, rivals_of, separating_experiment
from diagnosis.experiment.signal_design import Limits

__all__ = ["Experiment", "Limits", "rivals_of", "separating_experiment"]
