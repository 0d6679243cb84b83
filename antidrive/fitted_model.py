"""From a fit to the model file that carries it on."""

from __future__ import annotations

from identification.fit_result import Fit
from plant.drive_train import DriveTrain
from plant.model_file import ModelFile


def model_file(fit: Fit, gears: DriveTrain | None = None) -> ModelFile:
    """The fitted model with its standard errors, the files that it came from, and the gears they were read with."""
    return fit.model_file(gears)
