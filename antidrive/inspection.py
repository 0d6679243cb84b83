"""Interpretation of a log before anything is fitted: its columns, units, runs, gaps and faults."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from antidrive.log_options import LogOptions
from identification.errors import MalformedLog, MissingColumns
from identification.log import Log
from identification.reading.files import read_table
from identification.reading.inventory import ColumnFacts, inventory, lines
from identification.reading.joints import select_joint
from identification.reading.reading_options import Reading
from identification.reading.recognition import joined_if_needed, recognise
from identification.reading.table import Table
from identification.reading.units import kind_of
from identification.run import Run
from plant.errors import BadParameter


@dataclass(frozen=True, kw_only=True, eq=False)
class Inspection:
    """A log and its interpretation.

    Attributes:
        options: options with which it was read.
        tables: name of each table, and the facts of its columns.
        log: the log; `holdout` is the validation log.
    """

    options: LogOptions
    tables: tuple[tuple[str, tuple[ColumnFacts, ...]], ...]
    log: Log
    holdout: Log | None

    def log_file(self, folder: Path) -> str:
        """The text of a log.toml for a folder."""
        from antidrive.log_file import log_file

        columns: dict[str, str] = {}
        units: dict[str, str] = {}
        for _, facts in self.tables:
            for one in facts:
                if one.used_as and one.used_as not in columns:
                    columns[one.used_as] = one.name
                    if one.unit and kind_of(one.unit) is not None:
                        units[one.used_as] = one.unit
        kept = {column: unit for column, unit in units.items() if column not in self.options.scales}
        return log_file(self.options, folder, columns, kept)

    def sentences(self) -> list[str]:
        """The interpretation in sentences, one per line."""
        text_lines = [*_columns(self.tables), *self._assumed(), ""] if self.tables else []
        text_lines += [f"{self.log!r}, command in {self.log.command_unit}", *_table(self.log.runs)]
        if self.holdout is not None:
            text_lines += ["To validate on:", *_table(self.holdout.runs)]
        text_lines += [f"  unusable: {text}" for text in self.log.faults]
        text_lines += [f"  warning: {text}" for text in (*self.log.warnings, *self.log.notes)]
        text_lines += [f"  repaired: {text}" for text in self.log.repairs]
        return text_lines

    def _assumed(self) -> list[str]:
        if not any(one.assumed and not one.unit for _, facts in self.tables for one in facts):
            return []
        return ["  A unit in brackets is assumed; give another one with --unit."]

    def summary(self) -> dict[str, Any]:
        """The interpretation as data."""
        return {
            "schema": 1,
            "tables": [{"name": name, "columns": [vars(one) for one in facts]} for name, facts in self.tables],
            "axis": self.log.axis,
            "command_unit": self.log.command_unit,
            "runs": [_facts(run) for run in self.log.runs],
            "data": {
                "faults": list(self.log.faults),
                "warnings": [*self.log.warnings, *self.log.notes],
                "repairs": list(self.log.repairs),
            },
            "source": [{"file": source.file, "sha256": source.sha256} for source in self.log.sources],
        }


def inspected(options: LogOptions, tell: Callable[[str], None] | None = None) -> Inspection:
    """Read a log and interpret it.

    Raises:
        MalformedLog: it cannot be interpreted.
        BadParameter: options that do not fit the log.
    """
    if options.dataset is not None or not options.files:
        measured = options.read(tell)
        return Inspection(options=options, tables=(), log=measured.log, holdout=measured.holdout)
    reading = options.reading()
    tables = [read_table(path) for path in options.files]
    facts = tuple(_understood(table, reading) for table in joined_if_needed(tables, reading))
    held = options.read_holdout(reading)
    try:
        log = Log.of_tables(tables, reading)
    except MissingColumns:  # it has the columns already
        raise
    except (MalformedLog, BadParameter) as error:
        raise type(error)("\n".join([str(error), *_columns(facts)])) from error
    return Inspection(options=options, tables=facts, log=log, holdout=held)


def _columns(tables: Sequence[tuple[str, tuple[ColumnFacts, ...]]]) -> list[str]:
    """The columns of each table, as lines."""
    text_lines: list[str] = []
    for name, facts in tables:
        rows = max((one.samples for one in facts), default=0)
        text_lines += [f"{name}: {rows} rows, {len(facts)} columns", *lines(facts)]
    return text_lines


def _understood(table: Table, reading: Reading) -> tuple[str, tuple[ColumnFacts, ...]]:
    own = {column: name for column, name in reading.mapping.items() if name in table.columns}
    chosen = select_joint(table, reading.joint, mapped=list(own.values()))
    facts = inventory(chosen, recognise(chosen, reading))
    units = {column: unit for column, unit in reading.units.items()}
    return table.name, tuple(replace(one, unit=units.get(one.used_as, one.unit)) for one in facts)


def _facts(run: Run) -> dict[str, Any]:
    steps = np.diff(run.time)
    return {
        "run": run.run,
        "samples": len(run),
        "duration": run.duration,
        "sample_time": run.sample_time,
        "jitter": float(np.std(steps) / run.sample_time),
        "longest_gap": float(steps.max()),
        "masked": int(np.sum(~run.valid)),
    }


def _table(runs: tuple[Run, ...]) -> list[str]:
    heads = ("run", "samples", "duration [s]", "sample time [ms]", "jitter [%]", "longest gap [ms]", "masked")
    rows = [heads]
    for one in map(_facts, runs):
        rows.append(
            (
                one["run"],
                str(one["samples"]),
                f"{one['duration']:.5g}",
                f"{1e3 * one['sample_time']:.4g}",
                f"{100 * one['jitter']:.2g}",
                f"{1e3 * one['longest_gap']:.4g}",
                str(one["masked"]),
            )
        )
    widths = [max(len(row[place]) for row in rows) for place in range(len(heads))]
    return ["  " + "  ".join(cell.rjust(w) for cell, w in zip(row, widths, strict=True)) for row in rows]


def inspection_figures(log: Log, most: int = 4) -> list[tuple[str, Any]]:
    """Label and figure of the first runs: command and response over time."""
    from antidrive import chart, figures

    unit = "rad" if log.axis == "rotary" else "m"
    drawn = []
    for run in log.runs[:most]:
        rows = [
            (f"command [{log.command_unit}]", [("command", chart.BEFORE, run.command)]),
            (f"response [{unit}]", [("response", chart.AFTER, np.where(run.valid, run.output, np.nan))]),
        ]
        drawn.append((run.label, figures.traces_figure(run.time, rows, bounds={})))
    return drawn
