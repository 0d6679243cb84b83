"""What a model says will follow from a log's command, as a table: run, time, and angle or position."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from antidrive.time_left import Parts, Tell
from identification.log import Log
from identification.simulation import free_simulation
from plant.effects.effect import Array
from plant.errors import BadParameter
from plant.servo import ServoModel

_ROWS = 10_000  # that are written before somebody is told


def write_prediction(
    path: Path, log: Log, model: ServoModel, *, window: float | None = None, tell: Tell | None = None
) -> list[Array]:
    """Simulate a log freely and write the table as CSV.

    Args:
        path: file to write.
        log: whose command is played.
        model: what it is played to.
        window: restart every so many seconds; None simulates each run in one piece.
        tell: called with a line of text at each hundredth.

    Returns:
        One (T,) simulated output a run [rad or m].

    Raises:
        BadParameter: the model runs away to infinity, or does not fit the log.
    """
    import pandas as pd

    done = Parts(2 * sum(map(len, log.runs)), tell, doing="predicting").done
    simulated = free_simulation(log, model, window=window, after=done)
    if not all(np.isfinite(output).all() for output in simulated):
        raise BadParameter("Simulated over this log, the model runs away to infinity; use another model.")
    column = "angle" if log.axis == "rotary" else "position"
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(f"run,time,{column}\n")
        for run, output in zip(log.runs, simulated, strict=True):
            for first in range(0, len(run), _ROWS):
                rows = slice(first, first + _ROWS)
                table = pd.DataFrame({"run": run.run, "time": run.zero + run.time[rows], column: output[rows]})
                # a clock may need more digits than a prediction is worth
                table[column] = table[column].map("{:.10g}".format)
                table.to_csv(file, header=False, index=False, float_format="%.15g")
                done(len(table))
    return simulated
