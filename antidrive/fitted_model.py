"""From a fit to the model file that carries it on."""

from __future__ import annotations

from identification.fit_result import Fit
from plant.drive_train import DriveTrain
from plant.model_file import ModelFile


def model_file(fit: Fit, gears: DriveTrain | None = None) -> ModelFile:
    """The fitted model with its standard errors, the files that it came from, and the gears they were read with."""
    return ModelFile(
        model=fit.model,
        std={p.name: p.std for p in fit.parameters},
        sample_time=fit.log.runs[0].sample_time,
        gears=gears,
        source=tuple({"file": s.file, "sha256": s.sha256} for s in fit.log.sources),
    )
