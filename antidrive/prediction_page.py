"""Page of a prediction compared with the measurement."""

from __future__ import annotations

import numpy as np

from antidrive.html_page import page
from antidrive.prediction import Prediction, quantity
from antidrive.provenance import Provenance

_DRAWN = 6  # number of runs drawn, those with the largest errors


def prediction_page(found: Prediction, provenance: Provenance) -> str:
    """The runs with the largest errors, as measured and simulated."""
    from antidrive.figures import fit_figure

    log, unit = found.log, found.log.measured_unit
    runs = list(zip(log.runs, found.simulated, found.rms_errors, found.sentences(), strict=True))
    pictures = []
    for run, output, _, sentence in sorted(runs, key=lambda entry: -entry[2])[:_DRAWN]:
        seen = np.where(run.valid, run.measured, np.nan)
        pictures.append((fit_figure(run.time, seen, output, quantity(log), unit), f"{sentence}."))
    lines = [
        "Open-loop simulation from the command alone. The initial state of each run is estimated from its first 0.2 s.",
        "The rms error is that of measured less simulated, with a standard error from leaving out each twentieth of "
        "the run in turn.",
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
