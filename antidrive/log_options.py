"""Files of a log and their interpretation: from the options of a command, a log.toml, or a known data set."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from antidrive.fit_options import FitOptions
from antidrive.remaining_time import Parts, Tell
from identification.log import Log
from identification.reading.reading_options import Reading
from plant.errors import BadParameter
from plant.gears import GearTrain, Ratios
from plant.servo import ServoModel

Value = TypeVar("Value")

NUMBERS = ("rate", "torque_constant", "kp", "kd")


@dataclass(frozen=True, kw_only=True)
class Measured:
    """The log to fit, the validation log if one was given, and the start of the fit for a known machine.

    Attributes:
        base: model to start from; None if nothing is known.
        fixed: parameters that the machine does not have.
        inverse: whether its torque is to be predicted from the motion; None if that is not known.
    """

    log: Log
    holdout: Log | None = None
    notes: tuple[str, ...] = ()
    base: ServoModel | None = None
    fixed: tuple[str, ...] = ()
    inverse: bool | None = None

    def absent(self, start: ServoModel | None) -> tuple[str, ...]:
        """Parameters that the known machine does not have, which are not fitted, unless the user gave a model."""
        return self.fixed if start is None else ()


@dataclass(frozen=True, kw_only=True)
class LogOptions:
    """Files of a log and their interpretation.

    Attributes:
        files: log files.
        mapping, units, scales: by column of the log contract.
        gears, ratio: teeth "20,20:161" or reduction "8.05" of two drives, as typed.
        rate, torque_constant, kp, kd, joint: as in `identification.reading.reading_options.Reading`.
        dataset: name of a known data set, read from `data` or from `files`.
        data: folder of the data set.
        holdout: files of the validation log.
        fit: settings of a log.toml for parameters and effects.
    """

    files: tuple[Path, ...] = ()
    mapping: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    scales: Mapping[str, float] = field(default_factory=dict)
    gears: str | None = None
    ratio: str | None = None
    rate: float | None = None
    torque_constant: float | None = None
    kp: float | None = None
    kd: float | None = None
    joint: str | None = None
    dataset: str | None = None
    data: Path | None = None
    holdout: tuple[Path, ...] = ()
    fit: FitOptions = field(default_factory=FitOptions)

    @classmethod
    def typed(
        cls,
        *,
        files: Sequence[Path],
        mapping: Sequence[str],
        units: Sequence[str],
        scales: Sequence[str],
        holdout: Sequence[Path],
        **given: Any,
    ) -> LogOptions:
        """From the words of a command line; `given` are attributes that need no conversion.

        Raises:
            BadParameter: a word with a wrong form.
        """
        return cls(
            files=tuple(files),
            mapping=pairs("--map", mapping, str, "angle=qm"),
            units=pairs("--unit", units, str, "angle=deg"),
            scales=pairs("--scale", scales, _factor, "torque=35.15"),
            holdout=tuple(holdout),
            **given,
        )

    def overruled(self, other: LogOptions) -> LogOptions:
        """These options, overridden by all others except their files."""
        single = ("rate", "torque_constant", "kp", "kd", "joint", "dataset", "data", "gears", "ratio")
        given = {name: value for name in single if (value := getattr(other, name)) is not None}
        if "gears" in given or "ratio" in given:
            given = {"gears": None, "ratio": None, **given}
        return replace(
            self,
            mapping={**self.mapping, **other.mapping},
            units={**self.units, **other.units},
            scales={**self.scales, **other.scales},
            holdout=other.holdout or self.holdout,
            **given,
        )

    def reading(self) -> Reading:
        """The interpretation of the files.

        Raises:
            BadParameter: unusable numbers or gears.
        """
        if self.gears is not None and self.ratio is not None:
            raise BadParameter("--gears and --ratio both describe the gear train; give one of them.")
        gears = GearTrain.parse(self.gears) if self.gears is not None else None
        return Reading(
            mapping=self.mapping,
            units=self.units,
            scales=self.scales,
            gears=gears if self.ratio is None else Ratios.parse(self.ratio),
            rate=self.rate,
            torque_constant=self.torque_constant,
            kp=self.kp,
            kd=self.kd,
            joint=self.joint,
        )

    def read(self, tell: Tell | None = None) -> Measured:
        """Read all given files; `tell` reports the progress.

        Raises:
            BadParameter: options that contradict each other, or have a wrong form.
            MalformedLog: a file that cannot be used.
        """
        if self.dataset is not None:
            return self._known()
        if self.data is not None:
            raise BadParameter("--data names the folder of a known data set; add --dataset NAME.")
        if not self.files:
            raise BadParameter("No log is given; name one or more files, or --dataset NAME --data FOLDER.")
        done = Parts(2 * (len(self.files) + len(self.holdout)), tell, doing="reading").done
        reading = self.reading()
        log = Log.of_files(self.files, reading, done)
        holdout = self.read_holdout(reading, done)
        if holdout is not None:
            from diagnosis.validation_split import fitted_too

            if (both := fitted_too(log, holdout)) is not None:
                raise BadParameter(f"--holdout {both}: is fitted too, so it validates nothing; give another log.")
        return Measured(log=log, holdout=holdout)

    def read_holdout(self, reading: Reading, done: Callable[[], None] = lambda: None) -> Log | None:
        """The validation log, read like the log; None without one.

        Where names of columns have the name of a file before them, the validation files take the places of the log's.
        """
        if not self.holdout:
            return None
        if len(self.holdout) == len(self.files):
            instead = {one.stem: other.stem for one, other in zip(self.files, self.holdout, strict=True)}
            mapping = {column: _in_file(name, instead) for column, name in reading.mapping.items()}
            reading = replace(reading, mapping=mapping)
        return Log.of_files(self.holdout, reading, done)

    def _known(self) -> Measured:
        typed = {"--map": self.mapping, "--unit": self.units, "--scale": self.scales, "--gears": self.gears}
        typed |= {"--ratio": self.ratio, **{f"--{name.replace('_', '-')}": getattr(self, name) for name in NUMBERS}}
        for option, given in typed.items():
            if given:
                raise BadParameter(
                    f"{option} cannot be used with --dataset: the names and units of a data set are known."
                )
        if self.holdout:
            raise BadParameter("--holdout cannot be used with --dataset: a data set has its own validation part.")
        if (self.data is None) == (not self.files):
            raise BadParameter(
                f"--dataset {self.dataset}: give either --data FOLDER or the files of the data set, and not both."
            )
        if self.joint is not None and not self.joint.isdecimal():
            raise BadParameter(f"--joint {self.joint}: the joints of a data set are numbered; give its number.")
        from identification.datasets import load_dataset

        files = self.data if self.data is not None else list(self.files)
        loaded = load_dataset(str(self.dataset), files, joint=None if self.joint is None else int(self.joint))
        return Measured(
            log=loaded.estimation,
            holdout=loaded.holdout,
            notes=loaded.notes,
            base=loaded.base,
            fixed=loaded.fixed,
            inverse=loaded.inverse,
        )


def _in_file(name: str, instead: Mapping[str, str]) -> str:
    """A name of a column, `drive/torque`, with another file before it."""
    file, slash, column = name.partition("/")
    return f"{instead[file]}/{column}" if slash and file in instead else name


def _factor(text: str) -> float:
    """A number, or the ratio of two: "1/32"."""
    number, slash, divisor = text.partition("/")
    if slash and float(divisor) == 0.0:
        raise ValueError
    return float(number) / float(divisor) if slash else float(number)


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
