"""Page of a prediction compared with the measurement."""

from __future__ import annotations

import numpy as np

from antidrive.html_page import page
from antidrive.prediction import Prediction
from antidrive.provenance import Provenance

_DRAWN = 6  # number of runs drawn, those with the largest errors


def prediction_page(found: Prediction, provenance: Provenance) -> str:
    """The runs with the largest errors, as measured and simulated."""
    from antidrive.figures import fit_figure

    log, unit = found.log, found.log.measured_unit
    runs = list(zip(log.runs, found.simulated, found.rms_errors, strict=True))
    pictures = []
    for run, output, error in sorted(runs, key=lambda entry: -entry[2])[:_DRAWN]:
        seen = np.where(run.valid, run.measured, np.nan)
        figure = fit_figure(run.time, seen, output, unit)
        pictures.append((figure, f"{run.label}: rms error {error:.4g} {unit}."))
    lines = [
        "Open-loop simulation from the command alone. The initial state of each run is estimated from its first 0.2 s."
    ]
    if len(runs) > _DRAWN:
        lines += [f"Drawn are the {_DRAWN} of {len(runs)} runs with the largest errors."]
    return page(
        "picture",
        provenance,
        "Measured and simulated",
        kind="Prediction",
        sentences=lines,
        pictures=pictures,
        data={"warnings": log.warnings, "repairs": log.repairs, "notes": log.notes},
    )
