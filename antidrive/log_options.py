"""From the words on the command line to a log: files or a known data set, names, units and scales."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from antidrive.time_left import Parts, Tell
from identification.log import Log
from plant.errors import BadParameter
from plant.servo import ServoModel

Value = TypeVar("Value")


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What was read: the log to learn from, the log to judge by if one was set apart, and where a known machine starts.

    Attributes:
        base: model to start from, and `fixed` its parameters that the machine does not have; None if nothing is known.
    """

    log: Log
    holdout: Log | None = None
    notes: tuple[str, ...] = ()
    base: ServoModel | None = None
    fixed: tuple[str, ...] = ()

    def absent(self, start: ServoModel | None) -> tuple[str, ...]:
        """Parameters to leave as they are: those that the known machine does not have, unless the user gave a model."""
        return self.fixed if start is None else ()


@dataclass(frozen=True, kw_only=True)
class LogOptions:
    """The options of one command that say where the log is and how to read it.

    Attributes:
        files: log files.
        mapping, units, scales: "column=value" each.
        dataset: name of a known data set, read from `data` or from `files`.
        data: folder of the data set.
        joint: of a data set that has several.
        holdout: files to judge by.
    """

    files: tuple[Path, ...] = ()
    mapping: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    scales: tuple[str, ...] = ()
    dataset: str | None = None
    data: Path | None = None
    joint: int | None = None
    holdout: tuple[Path, ...] = ()

    def read(self, tell: Tell | None = None) -> Measured:
        """Read everything that was named, and `tell` how far that is.

        Raises:
            BadParameter: options that contradict each other, or are written wrongly.
            MalformedLog: a file that cannot be used.
        """
        if self.dataset is not None:
            return self._known()
        if self.data is not None:
            raise BadParameter("--data names the folder of a known data set; add --dataset NAME.")
        if self.joint is not None:
            raise BadParameter("--joint chooses among the joints of a known data set; add --dataset NAME.")
        if not self.files:
            raise BadParameter("No log is given; name one or more files, or --dataset NAME --data FOLDER.")
        done = Parts(2 * (len(self.files) + len(self.holdout)), tell, doing="reading").done
        log = self._files(self.files, done)
        return Measured(log=log, holdout=self._files(self.holdout, done) if self.holdout else None)

    def _files(self, paths: tuple[Path, ...], done: Callable[[], None]) -> Log:
        return Log.read(
            paths,
            mapping=pairs("--map", self.mapping, str, "angle=qm"),
            units=pairs("--unit", self.units, str, "angle=deg"),
            scales=pairs("--scale", self.scales, float, "torque=35.15"),
            after=done,
        )

    def _known(self) -> Measured:
        for option, given in (("--map", self.mapping), ("--unit", self.units), ("--scale", self.scales)):
            if given:
                raise BadParameter(f"{option} does not go with --dataset: the names and units of a data set are known.")
        if self.holdout:
            raise BadParameter("--holdout does not go with --dataset: a data set says itself what is held out.")
        if (self.data is None) == (not self.files):
            raise BadParameter("--dataset needs either --data FOLDER or the files of the data set.")
        from identification.datasets import load_dataset

        loaded = load_dataset(
            str(self.dataset), self.data if self.data is not None else list(self.files), joint=self.joint
        )
        return Measured(
            log=loaded.estimation, holdout=loaded.holdout, notes=loaded.notes, base=loaded.base, fixed=loaded.fixed
        )


def pairs(option: str, given: Sequence[str], convert: Callable[[str], Value], example: str) -> dict[str, Value]:
    """The entries `column=value` of a repeatable option as a dictionary.

    Raises:
        BadParameter: an entry without "=", a value that cannot be converted, or a column named twice.
    """
    found: dict[str, Value] = {}
    for entry in given:
        column, equals, text = (part.strip() for part in entry.partition("="))
        if not (column and equals and text):
            raise BadParameter(f"{option} {entry!r}: write it as column=value, for example {option} {example}.")
        if column in found:
            raise BadParameter(f"{option} names the column '{column}' twice; give it once.")
        try:
            found[column] = convert(text)
        except ValueError:
            raise BadParameter(f"{option} {entry!r}: {text!r} is not a number.") from None
    return found
