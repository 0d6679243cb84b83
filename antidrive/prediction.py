"""Open-loop simulation of a log from its command, beside what was measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from antidrive.remaining_time import Parts, Tell
from diagnosis.explanation.wording import torque_or_force
from diagnosis.jackknife import jackknife
from identification.log import Log
from identification.log_like import LogLike, log_of
from identification.simulation import free_simulation
from plant.effects.effect import Array
from plant.errors import BadParameter
from plant.file_format import check_format
from plant.model_file import ModelLike, model_of
from plant.result_display import Drawn
from plant.servo import ServoModel
from plant.uncertain_number import measured as measured_text

if TYPE_CHECKING:
    import pandas as pd

TABLES = (".csv", ".parquet", ".json", ".xlsx")
"""Formats of a prediction, by the end of the file's name."""

_SHEET = 1_048_575  # rows of an Excel sheet below its headings
_ROWS = 10_000  # rows between two reports of progress
_WRITING = 4  # time to write a row over that to simulate a sample of a run in one piece
_SETTLING = 4  # time for a sample in a window, with its initial state estimated, over that to write its row


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction(Drawn):
    """A log simulated in open loop, beside what was measured.

    Attributes:
        log: the simulated log.
        simulated: one (T,) output per run, in the log's unit.
    """

    log: Log
    simulated: tuple[Array, ...]

    @property
    def rms_errors(self) -> tuple[float, ...]:
        """Rms error of each run over its valid samples, in the log's unit."""
        return tuple(
            float(np.sqrt(np.mean((output - run.measured)[run.valid] ** 2)))
            for run, output in zip(self.log.runs, self.simulated, strict=True)
        )

    def sentences(self) -> list[str]:
        """The error of each run with its standard error, from leaving out each twentieth of the run in turn."""
        lines = []
        for run, output, error in zip(self.log.runs, self.simulated, self.rms_errors, strict=True):
            std = jackknife(np.sqrt, (output - run.measured)[run.valid] ** 2)
            lines.append(f"{run.label}: rms error {measured_text(error, std, self.log.measured_unit)}")
        return lines

    def __str__(self) -> str:
        """The sentences."""
        return "\n".join(self.sentences())

    def __repr__(self) -> str:
        """The log and the largest error in one line."""
        return f"Prediction({self.log!r}; largest rms error {max(self.rms_errors):.4g} {self.log.measured_unit})"


def predict(model: ModelLike, log: LogLike, *, window: float | None = None) -> Prediction:
    """Simulate a log in open loop, from its command alone.

    Args:
        model: the servo, its model file, or the path of one.
        log: gives the command; also a path, a DataFrame or arrays by name. Its measured output is used only in the
            first 0.2 s of each run, or window, for the initial state.
        window: restart every so many seconds (multi-step prediction); None simulates each run in one piece.

    Returns:
        The simulated output beside the measured one. Its table has one row per sample: run, time [s], what the log
        measures, simulated (angle [rad], position [m], or velocity [rad/s or m/s] of a log of the speed alone), and
        measured.

    Raises:
        BadParameter: the model diverges, or does not fit the log.
        BadModelFile, MalformedLog: a file that cannot be used.
    """
    read = log_of(log)
    return _simulated(read, model_of(model), window, None)


def write_prediction(
    path: Path,
    log: Log,
    model: ServoModel,
    *,
    window: float | None = None,
    measured: bool = False,
    tell: Tell | None = None,
) -> Prediction:
    """Simulate a log in open loop and write run, time and output.

    Args:
        path: file to write, in the format of its suffix.
        log, model, window: as in `predict`.
        measured: add the measured output as a last column.
        tell: called with a line of text at each hundredth.

    Raises:
        BadParameter: as `predict` does; or the format cannot be written.
    """
    simulating, writing = (1, _WRITING) if window is None else (_SETTLING, 1)  # relative time for a sample, in parts
    done = Parts((simulating + writing) * sum(map(len, log.runs)), tell, doing="predicting").done
    found = _simulated(log, model, window, lambda samples: done(simulating * samples))
    if path.suffix.lower() in ("", ".csv"):
        _write_csv(path, found, measured, lambda rows: done(writing * rows))
    else:
        table = found.to_frame() if measured else found.to_frame().drop(columns="measured")
        _write_table(path, table)
        done(writing * len(table))
    return found


def check_table(out: Path) -> None:
    """Raise `BadParameter` if no prediction is written in the format of that suffix."""
    check_format(out, TABLES, option="--out")
    if out.suffix.lower() == ".xlsx":
        try:
            import openpyxl  # noqa: F401
        except ImportError:
            raise BadParameter(f"--out {out}: Excel needs openpyxl: pip install openpyxl.") from None


def table(found: Prediction, run: int, rows: slice = slice(None)) -> pd.DataFrame:
    """Run, time, and simulated and measured output of one run."""
    import pandas as pd

    shown, output = found.log.runs[run], found.simulated[run][rows]
    name, clock = quantity(found.log), shown.zero + shown.time[rows]
    return pd.DataFrame({"run": shown.run, "time": clock, name: output, "measured": shown.measured[rows]})


def quantity(log: Log) -> str:
    """Name of what is predicted: angle, position or velocity; of an inverse model torque or force."""
    if log.response == "velocity":
        return "velocity"
    if log.response == "torque":
        return torque_or_force(log.command_unit)
    return "angle" if log.axis == "rotary" else "position"


def _simulated(log: Log, model: ServoModel, window: float | None, done: Callable[[int], None] | None) -> Prediction:
    simulated = free_simulation(log, model, window=window, after=done)
    if not all(np.isfinite(output).all() for output in simulated):
        raise BadParameter("In simulation of this log the model diverges; use another model.")
    return Prediction(log=log, simulated=tuple(simulated))


def _write_csv(path: Path, found: Prediction, measured: bool, done: Callable[[int], None]) -> None:
    names = ["run", "time", quantity(found.log), *(["measured"] if measured else [])]
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(names) + "\n")
        for number, run in enumerate(found.log.runs):
            for first in range(0, len(run), _ROWS):
                rows = table(found, number, slice(first, first + _ROWS))[names]
                for column in names[2:]:  # a clock may need more digits than a prediction
                    rows[column] = rows[column].map("{:.10g}".format)
                rows.to_csv(file, header=False, index=False, float_format="%.15g")
                done(len(rows))


def _write_table(path: Path, rows: pd.DataFrame) -> None:
    match path.suffix.lower():
        case ".parquet":
            rows.to_parquet(path, index=False)
        case ".json":
            rows.to_json(path, orient="records", double_precision=15)
        case _ if len(rows) > _SHEET:
            raise BadParameter(
                f"An Excel sheet has {_SHEET} rows, this prediction {len(rows)}; write .csv or .parquet."
            )
        case _:
            rows.to_excel(path, index=False)
