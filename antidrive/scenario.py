"""A scenario of a closed loop, read from TOML with every key checked."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from difflib import get_close_matches
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from antidrive.cli_drive_options import LIMITS, TUNING
from plant.errors import BadParameter
from plant.rig import Rig

Array = NDArray[np.float64]

NAMES = ("tracking", "figure7", "drive-loss", "disturbance")
"""The closed loops of the package; its other scenarios are experiments, see `antidrive.scenario_file`."""
_CONTROLLER = tuple(name for name in (*LIMITS, *TUNING) if name != "sample_time")
_REFERENCES = {
    "constant": ("level",),
    "sine": ("amplitude", "frequency"),
    "steps": ("levels", "hold"),
}
_LEAST_SAMPLES, _MOST_SAMPLES = 10, 200_000


@dataclass(frozen=True, kw_only=True)
class Disturbance:
    """A torque [N m] on the load between two times [s]."""

    torque: float
    start: float
    stop: float


@dataclass(frozen=True, kw_only=True)
class DriveLoss:
    """From a time on [s], one drive (1 or 2) gives no torque; the controller detects it after a delay [s]."""

    drive: int
    time: float
    detection: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """One closed loop on the rig.

    Attributes:
        name: of the scenario or its file.
        title: for users.
        duration, sample_time: [s].
        reference: kind and numbers; angles in rad, times in s, frequency in Hz.
        rig: fields of `plant.rig.Rig` that differ from the paper-like machine.
        controller: keywords of `mpc.Controller`.
        disturbance: torque on the load, if any.
        drive_loss: the drive that fails, if any.
        compare_single_drive: run the same motion again with drive 1 alone.
    """

    name: str
    title: str
    duration: float
    sample_time: float
    reference: Mapping[str, Any]
    rig: Mapping[str, float]
    controller: Mapping[str, Any]
    disturbance: Disturbance | None = None
    drive_loss: DriveLoss | None = None
    compare_single_drive: bool = False

    def __post_init__(self) -> None:
        """Raise for a duration that is too short or too long in samples."""
        if not (math.isfinite(self.sample_time) and self.sample_time > 0.0):
            raise BadParameter(f"{self.name}: sample_time must be finite and above zero, not {self.sample_time:g}.")
        if not _LEAST_SAMPLES <= self.duration / self.sample_time <= _MOST_SAMPLES:
            raise BadParameter(
                f"{self.name}: a duration of {self.duration:g} s is not between {_LEAST_SAMPLES} and {_MOST_SAMPLES} "
                f"samples of {self.sample_time:g} s; change one of them."
            )

    def wanted(self, time: Array) -> Array:
        """The reference angle [rad] at times (M,) [s]."""
        numbers = self.reference
        if numbers["kind"] == "constant":
            return np.full(time.shape, float(numbers["level"]))
        if numbers["kind"] == "sine":
            # A raised cosine that starts at rest and oscillates between 0 and twice the amplitude.
            return np.asarray(numbers["amplitude"] * (1.0 - np.cos(2.0 * np.pi * numbers["frequency"] * time)))
        levels = np.asarray(numbers["levels"], dtype=np.float64)
        return np.asarray(levels[np.minimum((time / numbers["hold"]).astype(int), levels.size - 1)])

    def pushes(self) -> Array:
        """(T,) disturbance torque on the load [N m]."""
        time = np.arange(round(self.duration / self.sample_time)) * self.sample_time
        if self.disturbance is None:
            return np.zeros(time.size)
        active = (time >= self.disturbance.start) & (time < self.disturbance.stop)
        return np.where(active, self.disturbance.torque, 0.0)

    def machine(self) -> Rig:
        """The rig of the scenario."""
        return Rig.paper_like(**self.rig)


def read_scenario(name: str) -> Scenario:
    """A scenario by its name, or from a TOML file.

    Raises:
        BadParameter: there is no such name or file, or the file has an unknown key or an unusable value.
    """
    return parse_scenario(name, scenario_text(name))


def scenario_text(name: str) -> str:
    """The text of a scenario of the package by its name, or of a TOML file; errors as in `read_scenario`."""
    folder = files("antidrive").joinpath("scenarios")
    own = sorted(file.name.removesuffix(".toml") for file in folder.iterdir())
    if name in own:
        return folder.joinpath(f"{name}.toml").read_text("utf-8")
    path = Path(name)
    if path.suffix != ".toml":
        raise BadParameter(f"There is no scenario {name!r}; name {', '.join(own)} or a TOML file.")
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise BadParameter(f"{name}: cannot be read ({error.strerror}).") from None
    except UnicodeDecodeError:
        raise BadParameter(f"{name}: is not a text in UTF-8.") from None


def parse_scenario(name: str, text: str) -> Scenario:
    """A scenario from the text of a TOML file; errors as in `read_scenario`, with `name` in front."""
    try:
        content = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise BadParameter(f"{name}: is not TOML ({error}).") from None
    table = partial(_table, name)
    known = tuple(field.name for field in fields(Scenario) if field.name != "name")
    _only(name, "the file", content, known)
    reference = _reference(name, table(content, "reference", None))
    rig = table(content, "rig", [field.name for field in fields(Rig) if field.name not in ("gears", "drives")])
    controller = table(content, "controller", list(_CONTROLLER))
    for key in rig:
        _number(name, f"rig.{key}", rig)
    controller = {key: _one_or_more(name, f"controller.{key}", controller) for key in controller}
    single = content.get("compare_single_drive", False)
    if not isinstance(single, bool):
        raise BadParameter(f"{name}: compare_single_drive must be true or false, not {single!r}.")
    return Scenario(
        name=Path(name).stem,
        title=str(content.get("title", Path(name).stem)),
        duration=_number(name, "duration", content, above=0.0),
        sample_time=_number(name, "sample_time", content, above=0.0),
        reference=reference,
        rig=rig,
        controller=controller,
        disturbance=_disturbance(name, table(content, "disturbance", ["torque", "start", "stop"])),
        drive_loss=_drive_loss(name, table(content, "drive_loss", ["drive", "time", "detection"])),
        compare_single_drive=single,
    )


def _reference(name: str, table: Mapping[str, Any]) -> Mapping[str, Any]:
    kind = table.get("kind")
    if kind not in _REFERENCES:
        raise BadParameter(f"{name}: reference.kind is {kind!r}; it must be one of {', '.join(_REFERENCES)}.")
    _only(name, "reference", table, ("kind", *_REFERENCES[kind]))
    for key in _REFERENCES[kind]:
        if key != "levels":
            _number(name, f"reference.{key}", table, above=0.0 if key in ("frequency", "hold") else -math.inf)
            continue
        levels = table.get("levels")
        if not (isinstance(levels, list) and levels and all(_is_number(level) for level in levels)):
            raise BadParameter(f"{name}: reference.levels must be a list of numbers [rad].")
    return table


def _disturbance(name: str, table: Mapping[str, Any]) -> Disturbance | None:
    if not table:
        return None
    numbers = {key: _number(name, f"disturbance.{key}", table) for key in ("torque", "start", "stop")}
    return Disturbance(**numbers)


def _drive_loss(name: str, table: Mapping[str, Any]) -> DriveLoss | None:
    if not table:
        return None
    if table.get("drive") not in (1, 2):
        raise BadParameter(f"{name}: drive_loss.drive must be 1 or 2, not {table.get('drive')!r}.")
    detection = _number(name, "drive_loss.detection", {"detection": 0.0, **table})
    if detection < 0.0:
        raise BadParameter(f"{name}: drive_loss.detection must not be negative, but is {detection:g} s.")
    return DriveLoss(drive=int(table["drive"]), time=_number(name, "drive_loss.time", table), detection=detection)


def _table(name: str, content: Mapping[str, Any], section: str, known: list[str] | None) -> Mapping[str, Any]:
    table = content.get(section, {})
    if not isinstance(table, dict):
        raise BadParameter(f"{name}: {section} must be a table, written as [{section}].")
    if known is not None:
        _only(name, section, table, known)
    return table


def _only(name: str, where: str, table: Mapping[str, Any], known: Any) -> None:
    unknown = sorted(set(table) - set(known))
    if unknown:
        raise BadParameter(f"{name}: {where} has the unknown key {unknown[0]!r}; {keys_like(unknown[0], known)}.")


def keys_like(unknown: str, known: Sequence[str]) -> str:
    """The known keys, or if there are many, those most similar to an unknown one."""
    if len(known) <= 12:
        return f"known are {', '.join(known)}"
    return f"the nearest known are {', '.join(get_close_matches(unknown, known, 5, 0.0))}"


def _number(name: str, path: str, table: Mapping[str, Any], *, above: float = -math.inf) -> float:
    value = table.get(path.rpartition(".")[2])
    if not _is_number(value) or not float(value) > above:
        positive = "" if math.isinf(above) else " above zero"
        raise BadParameter(f"{name}: {path} must be a finite number{positive}, not {value!r}.")
    return float(value)


def _one_or_more(name: str, path: str, table: Mapping[str, Any]) -> float | tuple[float, ...]:
    """A number, or one for each drive or each end."""
    given = table[path.rpartition(".")[2]]
    if isinstance(given, list) and given and all(_is_number(value) for value in given):
        return tuple(given)
    _number(name, path, table)
    return given  # type: ignore[no-any-return]


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
