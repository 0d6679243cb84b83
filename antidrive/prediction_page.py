"""Page of a prediction compared with the measurement."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from antidrive.html_page import page
from antidrive.provenance import Provenance
from identification.log import Log
from identification.run import Run
from plant.effects.effect import Array

_DRAWN = 6  # number of runs drawn, those with the largest errors


def rms_error(run: Run, simulated: Array) -> float:
    """Rms error of the valid samples [rad or m, or per second for a log of the speed]."""
    return float(np.sqrt(np.mean((simulated - run.measured)[run.valid] ** 2)))


def prediction_page(log: Log, simulated: Sequence[Array], provenance: Provenance) -> str:
    """The error of each run, and the runs with the largest errors as measured and simulated.

    Args:
        log: the simulated log.
        simulated: (T,) output of each run.
        provenance: of the prediction.
    """
    from antidrive.figures import fit_figure

    unit, runs = log.measured_unit, list(zip(log.runs, simulated, strict=True))
    pictures = []
    for run, output in sorted(runs, key=lambda pair: -rms_error(*pair))[:_DRAWN]:
        seen = np.where(run.valid, run.measured, np.nan)
        figure = fit_figure(run.time, seen, output, unit)
        pictures.append((figure, f"{run.label}: rms error {rms_error(run, output):.4g} {unit}."))
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
