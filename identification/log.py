"""`Log`: measured experiments, read and checked; every repair is reported."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal, Unpack, cast

import numpy as np
from numpy.typing import ArrayLike

from identification.checked_runs import checked_runs
from identification.errors import MalformedLog, UnusableLog
from identification.log_columns import ALIASES, COLUMNS
from identification.reading.columns import read_recordings
from identification.reading.files import read_table
from identification.reading.formats.frames import columns_of
from identification.reading.reading_options import How, Reading
from identification.reading.recognition import joined_if_needed
from identification.reading.table import Table, table_of
from identification.recording import Recording, Response, counted
from identification.run import Run
from plant.drive_train import DriveTrain
from plant.effects import Effect
from plant.errors import BadParameter
from plant.result_display import Drawn

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Axis", "Log", "Run", "Source"]

Axis = Literal["rotary", "linear"]


@dataclass(frozen=True, kw_only=True)
class Source:
    """A file (or "DataFrame", "arrays") and the hash of its content."""

    file: str
    sha256: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Log(Drawn):
    """Experiments on one machine.

    runs: at least one.
    warnings: findings, `repairs`: samples that were masked, continued or left out; one sentence each.
    faults: why no model can be fitted to the log as it is, and the option that helps; one sentence each.
    command_unit: "N m", "N", or the unit of the torque if its scale is unknown: "V", "A", or "rad" and "m" of a
        position servo's error; `notes` then say so.
    colour: autoregression of the measurement noise from `identification.coloured_noise`; empty for white noise.
    evenly_timed: whether `identification.time_stamp_jitter` replaced the time stamps by even times.
    unsettled: whether `identification.unsettled_start` found that hidden states do not begin settled.
    decimation: recorded samples per sample of an `identification.inverse_log`.

    Raises `MalformedLog` when there is no run.
    """

    runs: tuple[Run, ...]
    axis: Axis
    warnings: tuple[str, ...] = ()
    repairs: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    sources: tuple[Source, ...] = ()
    command_unit: str = "N m"
    notes: tuple[str, ...] = ()
    colour: tuple[float, ...] = ()
    evenly_timed: bool = False
    unsettled: bool = False
    decimation: int = 1

    _internal: ClassVar[frozenset[str]] = Drawn._internal | {
        "report",
        *(
            "colour",
            "decimation",
            "evenly_timed",
            "unsettled",
            "from_recordings",
            "head",
            "of_files",
            "of_tables",
            "shows",
        ),
        *("torque_unit", "usable"),
    }

    def __post_init__(self) -> None:
        """Raise an error for an empty log or an unknown axis."""
        if not self.runs:
            raise MalformedLog("the log holds no runs, give at least one.")
        if self.axis not in ("rotary", "linear"):
            raise BadParameter(f"the axis is '{self.axis}', it must be 'rotary' or 'linear'.")

    def __repr__(self) -> str:
        """Runs, samples, rate and duration in one line."""
        samples = sum(map(len, self.runs))
        rate = 1 / np.median([run.sample_time for run in self.runs])
        runs = f"{len(self.runs)} run{'s' * (len(self.runs) != 1)}"
        duration = sum(run.duration for run in self.runs)
        return f"Log({runs}, {samples} samples, {rate:.4g} Hz, {duration:.2f} s, {self.axis})"

    def usable(self, *, force: bool = False) -> Log:
        """The log if it has no faults; with `force` in any case, with its faults as warnings.

        Raises `UnusableLog` with the first fault and the number of the others.
        """
        if not self.faults:
            return self
        if not force:
            more = len(self.faults) - 1
            rest = f", and {counted(more, 'fault')} more" if more else ""
            raise UnusableLog(f"{self.faults[0]}{rest} (--force, in Python force=True, goes on as it is).")
        return replace(self, faults=(), warnings=(*self.faults, *self.warnings))

    @property
    def sample_time(self) -> float:
        """Sample time of the slowest run [s]."""
        return max(run.sample_time for run in self.runs)

    @cached_property  # not a property: jedi completes nothing in IPython if a property returns a Literal
    def response(self) -> Response:
        """The measured quantity that a model predicts: the "angle" (or position), the "velocity", or the "torque"."""
        return self.runs[0].response

    @property
    def measured_unit(self) -> str:
        """The unit of the measured quantity."""
        if self.response == "torque":
            return self.command_unit
        return {"rotary": "rad", "linear": "m"}[self.axis] + "/s" * (self.response == "velocity")

    def shows(self, kind: type[Effect]) -> bool:
        """Whether the log can show an effect: it exists on the log's axis, and needs no angle if none was measured.

        If the torque is what is predicted, from the motion, it needs to act on the load.
        """
        if self.response == "torque" and not kind.on_the_load():
            return False
        return self.axis in kind.axes and not (kind.needs_angle and self.response == "velocity")

    @property
    def torque_unit(self) -> str | None:
        """Unit of the torque if its scale is unknown, as in `ServoModel`; None for N m and N."""
        return None if self.command_unit in ("N m", "N") else self.command_unit

    @classmethod
    def read(
        cls,
        paths: str | Path | Sequence[str | Path],
        *,
        after: Callable[[], None] | None = None,
        **how: Unpack[How],
    ) -> Log:
        """Read one or several files of any known kind, see `identification.reading.files`; "-" is standard input.

        Two files of one experiment, one with the command and one with the response, are joined on their clocks, and
        files without a time row by row; a mapped name with that of its file, `drive/torque`, joins any number.

        how: names, units and facts that are not in the file, as in `identification.reading.reading_options.Reading`:
            `mapping={"angle": "qm"}`, `units={"angle": "deg"}`, `scales={"torque": 35.15}`, `gears`, `rate`,
            `torque_constant`, `kp`, `kd`, `joint`. A unit that is in the file need not be given. A unit may have a
            factor: `turn/131072` for counts, `2.4Nm/1000` for per mille of a rated torque.
        after: called twice per file: after reading and after the checks.

        Raises `MalformedLog` for a log that cannot be used and `BadParameter` for options that do not fit.
        """
        listed = [paths] if isinstance(paths, str | Path) else paths
        if not isinstance(listed, Sequence) or not all(isinstance(path, str | Path) for path in listed):
            raise BadParameter(f"Log.read needs the path of a file or a list of them, not {paths!r}.")
        return cls.of_files(listed, Reading(**how), after or (lambda: None))

    @classmethod
    def of_files(cls, paths: Sequence[str | Path], reading: Reading, done: Callable[[], None] = lambda: None) -> Log:
        """`read` for a `Reading`; `done` is called twice per file."""
        if not paths:
            raise BadParameter("no log is given, name at least one file.")
        tables = []
        for path in paths:
            tables.append(read_table(path))
            done()
        return cls.of_tables(tables, reading, done)

    @classmethod
    def of_tables(cls, tables: Sequence[Table], reading: Reading, done: Callable[[], None] = lambda: None) -> Log:
        """A log of tables that have been read; `done` is called once per table."""
        logs = []
        for table in joined_if_needed(tables, reading):
            logs.append(cls._from_table(table, reading))
            done()
        return cls.merge(logs)

    @classmethod
    def from_dataframe(
        cls,
        frame: pd.DataFrame,
        *,
        label: str = "DataFrame",
        **how: Unpack[How],
    ) -> Log:
        """A log from the columns of a DataFrame; arguments and errors as in `read`."""
        columns = columns_of(frame)
        reading = Reading(**how)
        return cls._from_table(table_of(columns, label), reading)

    @classmethod
    def from_arrays(
        cls,
        *,
        label: str = "arrays",
        units: Mapping[str, str] | None = None,
        scales: Mapping[str, float] | None = None,
        gears: DriveTrain | None = None,
        torque_constant: float | None = None,
        rate: float | None = None,
        **channels: ArrayLike,
    ) -> Log:
        """A log from arrays (T,) with the names of the log contract: `time=..., torque=..., angle=...`.

        Arguments and errors as in `read`; the gains `kp` and `kd` of a position servo are numbers or arrays.
        """
        gains = {
            name: float(cast(float, channels.pop(name)))
            for name in ("kp", "kd")
            if np.ndim(channels.get(name, ())) == 0
        }
        for name in channels:
            if ALIASES.get(name, name) not in COLUMNS:
                raise BadParameter(f"there is no channel '{name}', a log has {', '.join(COLUMNS)}.")
        reading = Reading(
            units=units or {},
            scales=scales or {},
            gears=gears,
            torque_constant=torque_constant,
            rate=rate,
            kp=gains.get("kp"),
            kd=gains.get("kd"),
        )
        columns = {}
        for name, values in channels.items():
            try:
                columns[name] = np.asarray(values)
            except ValueError as error:
                raise MalformedLog(f"{label}: the channel '{name}' is ragged, give one number a sample.") from error
        return cls._from_table(table_of(columns, label), reading)

    @classmethod
    def from_recordings(
        cls,
        recordings: Iterable[Recording],
        *,
        axis: Axis,
        sources: Sequence[Source],
        command_unit: str,
        notes: Sequence[str] = (),
    ) -> Log:
        """Check recordings and keep what can be used.

        Raises `MalformedLog` when a recording is unusable, all are too short, or nothing ever moves.
        """
        found = checked_runs(recordings)
        return cls(
            runs=found.runs,
            axis=axis,
            warnings=found.warnings,
            faults=found.faults,
            repairs=found.repairs,
            sources=tuple(sources),
            command_unit=command_unit,
            notes=tuple(notes),
        )

    @classmethod
    def _from_table(cls, table: Table, reading: Reading) -> Log:
        recorded = read_recordings(table, reading)
        log = cls.from_recordings(
            recorded.recordings,
            axis=cast(Axis, recorded.axis),
            sources=[Source(file=table.name, sha256=table.sha256)],
            command_unit=recorded.command_unit,
            notes=recorded.notes,
        )
        return replace(log, warnings=recorded.warnings + log.warnings)

    @classmethod
    def merge(cls, logs: Sequence[Log]) -> Log:
        """All runs of several logs of one machine, numbered in the order of the logs.

        If experiments have the same label in the run column, the numbers replace these labels in all runs.

        Raises `MalformedLog` when the logs differ in axis, in response or in the command's unit.
        """
        if not logs:
            raise MalformedLog("there are no logs to merge, give at least one.")
        first = logs[0]
        for log in logs[1:]:
            if log.response != first.response:
                raise MalformedLog(
                    f"{log.runs[0].label}: its response is the {log.response}, that of "
                    f"{first.runs[0].label} the {first.response}; use separate commands for them."
                )
            if (log.axis, log.command_unit) != (first.axis, first.command_unit):
                raise MalformedLog(
                    f"{log.runs[0].label}: a {log.axis} axis with a command in {log.command_unit}, but "
                    f"{first.runs[0].label} is a {first.axis} axis with a command in {first.command_unit}; use "
                    "separate commands for them."
                )
        notes = dict.fromkeys(note for log in logs for note in log.notes)
        numbers: dict[tuple[int, int], int] = {}  # pieces of one experiment have one number
        runs = [
            replace(run, number=numbers.setdefault((k, run.number), len(numbers)))
            for k, log in enumerate(logs)
            for run in log.runs
        ]
        if len({run.run for run in runs}) < len(numbers):
            runs = [replace(run, run=str(run.number)) for run in runs]
            notes["the runs of several files are numbered anew, in the order of the files"] = None
        return replace(
            first,
            runs=tuple(runs),
            warnings=tuple(text for log in logs for text in log.warnings),
            repairs=tuple(text for log in logs for text in log.repairs),
            faults=tuple(text for log in logs for text in log.faults),
            sources=tuple(dict.fromkeys(source for log in logs for source in log.sources)),
            notes=tuple(notes),
        )

    def head(self, n_runs: int) -> Log:
        """The first `n_runs` runs."""
        return replace(self, runs=self.runs[:n_runs])

    def select(self, runs: Sequence[int]) -> Log:
        """The runs with these indices (0 is the first), in this order."""
        wrong = [place for place in runs if not -len(self.runs) <= place < len(self.runs)]
        if wrong:
            raise BadParameter(f"there is no run at place {wrong[0]}, the log has {len(self.runs)} runs.")
        return replace(self, runs=tuple(self.runs[place] for place in runs))
