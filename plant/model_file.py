"""model.json: a servo model in a file."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias, get_args

from plant.drive_train import DriveTrain
from plant.effects import Effect, Moment, catalogue
from plant.effects.effect import Axis, Parameter, parameters_of
from plant.effects.nonparametric import unnamed
from plant.errors import AntidriveError, BadModelFile, BadParameter
from plant.file_format import check_format
from plant.gears import drive_train
from plant.number import finite
from plant.renamed import EFFECTS
from plant.servo import ServoModel
from plant.units import factor

SCHEMA = 1
_OTHERS = {
    "verdict": "a diagnosis",
    "log_likelihood": "a fit",
    "changes": "a comparison",
    "residual_rms": "a friction test",
}


@dataclass(frozen=True, kw_only=True)
class ModelFile:
    """Content of a model file.

    Attributes:
        model: the servo.
        std: standard errors of its parameters by name, None if unknown.
        sample_time: of the log of its fit [s], None for a model that was not fitted.
        source: files of its fit, each with "file" and "sha256".
        gears: of the machine, if the log was read with them.
    """

    model: ServoModel
    std: Mapping[str, float | None]
    sample_time: float | None = None
    source: tuple[Mapping[str, str], ...] = ()
    gears: DriveTrain | None = None

    def __getattr__(self, name: str) -> Any:
        """Explain where the model is, if the file is used in its place."""
        raise AttributeError(f"a ModelFile has no {name!r}; the servo that it holds is its attribute 'model'.")

    @property
    def identified(self) -> bool:
        """False if it was fitted to a log that determines no parameter; a model that was not fitted counts as known."""
        return not self.source or any(error is not None for error in self.std.values())

    @property
    def friction_std(self) -> float | None:
        """Relative standard error of the dry friction at rest; None if there is none or the error is unknown."""
        names, values, level = self.model.names, self.model.values, _level(self.model)
        if not level:
            return None
        square = 0.0
        for place, name in enumerate(names):
            values[place] += (step := 1e-3 * (abs(values[place]) or 1.0))
            slope = (_level(self.model.bound(values)) - level) / step
            values[place] -= step
            if slope and self.std.get(name) is None:
                return None
            square += (slope * (self.std.get(name) or 0.0)) ** 2
        return float(square**0.5 / level)

    def to_dict(self) -> dict[str, Any]:
        """The content of the file as a dictionary."""
        model = self.model
        entries = {
            spec.name: {"value": float(value), "std": finite(self.std.get(spec.name)), "unit": spec.unit}
            for spec, value in zip(model.parameters, model.values, strict=True)
        }
        effects = [
            {"name": e.name, "parameters": {s.name: entries[f"{e.name}.{s.name}"] for s in e.parameters()}}
            for e in model.effects
        ]
        return {
            "schema": SCHEMA,
            "axis": model.axis,
            "torque_unit": model.torque_unit or {"rotary": "N m", "linear": "N"}[model.axis],
            "parameters": {spec.name: entries[spec.name] for spec in parameters_of(type(model))},
            "effects": effects,
            "sample_time": finite(self.sample_time),
            "source": [dict(entry) for entry in self.source],
            "gears": None if self.gears is None else str(self.gears),
        }

    def write(self, path: Path) -> None:
        """Write the file atomically.

        Raises:
            BadParameter: the suffix is not .json.
            OSError: the file cannot be written there; a file that was there before stays.
        """
        check_format(path, (".json",))
        draft = path.with_name(path.name + ".part")
        try:
            draft.write_text(json.dumps(self.to_dict(), indent=2, allow_nan=False) + "\n")
            draft.replace(path)
        except OSError:
            draft.unlink(missing_ok=True)
            raise


ModelLike: TypeAlias = "ServoModel | ModelFile | str | Path"
"""A model, or a file that has one."""


def model_of(source: ModelLike) -> ServoModel:
    """The model itself, or that of a file.

    Raises:
        BadParameter: neither a model nor a path.
        BadModelFile: as `read_model` does.
    """
    if isinstance(source, ServoModel):
        return source
    if isinstance(source, str | Path):
        return read_model(source).model
    if isinstance(source, ModelFile):
        return source.model
    raise BadParameter(f"This needs a model: pass a ServoModel or the path of a model.json, not {source!r}.")


def write_model(model: ServoModel, path: Path | str) -> None:
    """Write a model as model.json, which `read_model` and every command read; `Fit.save` adds the standard errors."""
    ModelFile(model=model, std={}).write(Path(path))


def _level(model: ServoModel) -> float:
    """Dry friction at rest, forward [N m]."""
    levels = model.dry_friction(Moment(torque=1.0, inertia=model.inertia))
    return float(levels[0]) if levels else 0.0


def read_model(path: Path | str, effects: Iterable[type[Effect]] = ()) -> ModelFile:
    """Read a model file of this or an older schema.

    Args:
        path: of the file.
        effects: classes of effects that the model may have besides those of the catalogue.

    Raises:
        BadModelFile: the file is missing, is not JSON, or does not describe a servo; the sentence says where.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_bytes())  # detects a byte order mark
    except OSError as error:
        raise BadModelFile(f"{path}: cannot be read ({error.strerror}).") from None
    except (ValueError, RecursionError) as error:
        raise BadModelFile(f"{path}: is not JSON ({error}); expected a file that `antidrive identify` wrote.") from None
    try:
        return _parse(content, {**catalogue, **unnamed, **{kind.name: kind for kind in effects}})
    except AntidriveError as error:
        raise BadModelFile(f"{path}: {error}") from None


def _parse(content: Any, known: Mapping[str, type[Effect]]) -> ModelFile:
    content = _mapping(content, "the file")
    schema = content.get("schema")
    kind = next((kind for key, kind in _OTHERS.items() if key in content), None)
    if kind is not None or schema is None:
        reason = "without a schema this is no model" if kind is None else f"this is {kind}"
        raise BadModelFile(f"{reason}; give the model.json that `antidrive identify` or `diagnose` wrote.")
    if not isinstance(schema, int) or isinstance(schema, bool) or not 0 < schema <= SCHEMA:
        raise BadModelFile(f"schema is {schema!r}; this version reads schemas 1 to {SCHEMA}.")
    axis = content.get("axis", "rotary")
    if axis not in get_args(Axis):
        raise BadModelFile(f"axis must be 'rotary' or 'linear', not {axis!r}.")
    unit = content.get("torque_unit")  # in an older file the unit may be missing; then it is N m or N
    if unit is not None and not isinstance(unit, str):
        raise BadModelFile(f"torque_unit must be a unit such as 'N m' or 'V', not {unit!r}.")
    group = _Group(where="parameters", prefix="", axis=axis, torque_unit=unit)
    own, std = group.numbers(_mapping(content.get("parameters"), "parameters"), parameters_of(ServoModel))
    effects: list[Effect] = []
    listed = content.get("effects", [])
    if not isinstance(listed, list):
        raise BadModelFile("effects must be a list.")
    for place, entry in enumerate(listed):
        where = f"effects[{place}]"
        entry = _mapping(entry, where)
        name = entry.get("name")
        name = EFFECTS.get(name, name) if isinstance(name, str) else name
        if not isinstance(name, str) or name not in known:
            raise BadModelFile(
                f"{where}: unknown effect {name!r}; `antidrive effects` lists the known ones, and one of your own is "
                "read with --effects FILE.py (in Python: read_model(path, effects=[...]))."
            )
        group = _Group(where=where, prefix=f"{name}.", axis=axis, torque_unit=unit)
        given = _mapping(entry.get("parameters"), f"{where}.parameters")
        values, errors = group.numbers(given, known[name].parameters())
        effects.append(known[name](**values))
        std |= errors
    model = ServoModel(**own, effects=tuple(effects), axis=axis, torque_unit=unit)
    sample_time = content.get("sample_time")
    if sample_time is not None and not (finite(sample_time) or 0.0) > 0.0:
        raise BadModelFile(f"sample_time must be a positive number, not {sample_time!r}.")
    source = content.get("source") or []
    entries = source if isinstance(source, list) else [source]
    return ModelFile(
        model=model,
        std=std,
        sample_time=sample_time,
        source=tuple(_mapping(entry, "source") for entry in entries),
        gears=None if content.get("gears") is None else drive_train(content["gears"]),
    )


@dataclass(frozen=True, kw_only=True)
class _Group:
    """A group of parameters in a file: those of the model, or those of one effect."""

    where: str
    prefix: str
    axis: Axis
    torque_unit: str | None

    def numbers(
        self, given: Mapping[str, Any], specs: tuple[Parameter, ...]
    ) -> tuple[dict[str, float], dict[str, float | None]]:
        """Values by name, and standard errors by full name; an entry is a number or {"value", "std", "unit"}."""
        unknown = set(given) - {spec.name for spec in specs}
        if unknown:
            known = ", ".join(spec.name for spec in specs)
            raise BadModelFile(f"{self.where}: unknown parameter {min(unknown)!r}; known are {known}.")
        values, std = {}, {}
        for spec in specs:
            if spec.name not in given:
                if not spec.fitted:  # an older file without it: the effect's default
                    continue
                raise BadModelFile(f"{self.where}: parameter {spec.name!r} is missing.")
            entry = given[spec.name]
            entry = entry if isinstance(entry, Mapping) else {"value": entry}
            value, error = finite(entry.get("value")), finite(entry.get("std"))
            if value is None:
                raise BadModelFile(f"{self.where}: {spec.name} must be a finite number, not {entry.get('value')!r}.")
            size = self._factor(spec, entry.get("unit"))
            values[spec.name] = size * value
            std[self.prefix + spec.name] = None if error is None else size * error
        return values, std

    def _factor(self, spec: Parameter, unit: Any) -> float:
        if unit is None:
            return 1.0
        try:
            return factor(unit, spec.unit_on(self.axis, self.torque_unit))
        except BadModelFile as error:
            raise BadModelFile(f"{self.where}: {spec.name}: {error}.") from None


def _mapping(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise BadModelFile(f"{where} must be an object with named entries.")
    return value
