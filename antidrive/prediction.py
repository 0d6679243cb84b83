"""Open-loop simulation of a log from its command, as a table: run, time, and angle, position or velocity."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from antidrive.remaining_time import Parts, Tell
from identification.log import Log
from identification.log_like import LogLike, log_of
from identification.run import Run
from identification.simulation import free_simulation
from plant.effects.effect import Array
from plant.errors import BadParameter
from plant.model_file import ModelLike, model_of
from plant.servo import ServoModel

if TYPE_CHECKING:
    import pandas as pd

_ROWS = 10_000  # rows between two reports of progress
_WRITING = 4  # time to write a row over that to simulate a sample of a run in one piece
_SETTLING = 4  # time for a sample in a window, with its initial state estimated, over that to write its row


def predict(model: ModelLike, log: LogLike, *, window: float | None = None, measured: bool = False) -> pd.DataFrame:
    """Simulate a log in open loop, from its command alone.

    Args:
        model: the servo, its model file, or the path of one.
        log: gives the command; also a path, a DataFrame or arrays by name. Its measured output is used only in the
            first 0.2 s of each run, or window, for the initial state.
        window: restart every so many seconds (multi-step prediction); None simulates each run in one piece.
        measured: add the measured output as a last column.

    Returns:
        Columns run, time [s], and what the log measures: angle [rad], position [m], or velocity [rad/s or m/s] of a
        log of the speed alone. One row per sample; last `measured`, if requested.

    Raises:
        BadParameter: the model diverges, or does not fit the log.
        BadModelFile, MalformedLog: a file that cannot be used.
    """
    import pandas as pd

    read = log_of(log)
    simulated = _simulated(read, model_of(model), window, None)
    pairs = zip(read.runs, simulated, strict=True)
    tables = [_table(read, run, output, slice(None), measured) for run, output in pairs]
    return pd.concat(tables, ignore_index=True)


def write_prediction(
    path: Path,
    log: Log,
    model: ServoModel,
    *,
    window: float | None = None,
    measured: bool = False,
    tell: Tell | None = None,
) -> list[Array]:
    """Simulate a log in open loop and write the table as CSV.

    Args:
        path: file to write.
        log, model, window, measured: as in `predict`.
        tell: called with a line of text at each hundredth.

    Returns:
        One simulated output (T,) per run, in the log's unit.

    Raises:
        BadParameter: as `predict` does.
    """
    simulating, writing = (1, _WRITING) if window is None else (_SETTLING, 1)  # relative time for a sample, in parts
    done = Parts((simulating + writing) * sum(map(len, log.runs)), tell, doing="predicting").done
    simulated = _simulated(log, model, window, lambda samples: done(simulating * samples))
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(f"run,time,{_column(log)}{',measured' if measured else ''}\n")
        for run, output in zip(log.runs, simulated, strict=True):
            for first in range(0, len(run), _ROWS):
                table = _table(log, run, output, slice(first, first + _ROWS), measured)
                for column in table.columns[2:]:  # a clock may need more digits than a prediction
                    table[column] = table[column].map("{:.10g}".format)
                table.to_csv(file, header=False, index=False, float_format="%.15g")
                done(writing * len(table))
    return simulated


def _simulated(log: Log, model: ServoModel, window: float | None, done: Callable[[int], None] | None) -> list[Array]:
    simulated = free_simulation(log, model, window=window, after=done)
    if not all(np.isfinite(output).all() for output in simulated):
        raise BadParameter("In simulation of this log the model diverges; use another model.")
    return simulated


def _column(log: Log) -> str:
    if log.response == "velocity":
        return "velocity"
    return "angle" if log.axis == "rotary" else "position"


def _table(log: Log, run: Run, output: Array, rows: slice, measured: bool) -> pd.DataFrame:
    import pandas as pd

    beside = {"measured": run.measured[rows]} if measured else {}
    return pd.DataFrame({"run": run.run, "time": run.zero + run.time[rows], _column(log): output[rows], **beside})
