"""model.json: a servo model that outlives the program that found it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plant.effects import Effect, catalogue
from plant.effects.effect import parameters_of
from plant.effects.unnamed import unnamed
from plant.errors import AntidriveError, BadModelFile
from plant.servo import ServoModel

SCHEMA = 1


@dataclass(frozen=True, kw_only=True)
class ModelFile:
    """What a model file holds.

    Attributes:
        model: the servo.
        std: standard errors of its parameters by name, None where unknown.
        sample_time: of the log it was fitted to [s], None for a model that was written by hand.
        source: files that it was fitted to, each with "file" and "sha256".
    """

    model: ServoModel
    std: Mapping[str, float | None]
    sample_time: float | None = None
    source: tuple[Mapping[str, str], ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """The content of the file."""
        model = self.model
        entries = {
            spec.name: {"value": float(value), "std": self.std.get(spec.name), "unit": spec.unit}
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
            "sample_time": self.sample_time,
            "source": [dict(entry) for entry in self.source],
        }

    def write(self, path: Path) -> None:
        """Write the file as a whole or not at all."""
        draft = path.with_name(path.name + ".part")
        draft.write_text(json.dumps(self.to_dict(), indent=2, allow_nan=False) + "\n")
        draft.replace(path)


def read_model(path: Path | str) -> ModelFile:
    """Read a model file of this or an older schema.

    Raises:
        BadModelFile: the file is missing, is not JSON, or does not describe a servo; the sentence says where.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadModelFile(f"{path}: cannot be read ({error.strerror}).") from None
    except (ValueError, RecursionError) as error:
        raise BadModelFile(f"{path}: is not JSON ({error}); expected a file that `antidrive identify` wrote.") from None
    try:
        return _parse(content)
    except AntidriveError as error:
        raise BadModelFile(f"{path}: {error}") from None


def _parse(content: Any) -> ModelFile:
    content = _mapping(content, "the file")
    schema = content.get("schema")
    if not isinstance(schema, int) or isinstance(schema, bool) or not 0 < schema <= SCHEMA:
        raise BadModelFile(f"schema is {schema!r}; this version reads schemas 1 to {SCHEMA}.")
    std: dict[str, float | None] = {}
    own = _numbers(_mapping(content.get("parameters"), "parameters"), parameters_of(ServoModel), "parameters", "", std)
    effects: list[Effect] = []
    known: dict[str, type[Effect]] = {**catalogue, **unnamed}
    listed = content.get("effects", [])
    if not isinstance(listed, list):
        raise BadModelFile("effects must be a list.")
    for place, entry in enumerate(listed):
        where = f"effects[{place}]"
        entry = _mapping(entry, where)
        name = entry.get("name")
        if not isinstance(name, str) or name not in known:
            raise BadModelFile(f"{where}: unknown effect {name!r}; known are {', '.join(catalogue)}.")
        kind = known[name]
        given = _mapping(entry.get("parameters"), f"{where}.parameters")
        effects.append(kind(**_numbers(given, kind.parameters(), where, f"{name}.", std)))
    model = ServoModel(
        **own,
        effects=tuple(effects),
        axis=content.get("axis", "rotary"),
        torque_unit=content.get("torque_unit"),  # of an older file it is not known to be another than N m
    )
    sample_time = content.get("sample_time")
    if sample_time is not None and not (_is_number(sample_time) and sample_time > 0.0):
        raise BadModelFile(f"sample_time must be a positive number, not {sample_time!r}.")
    source = content.get("source") or []
    entries = source if isinstance(source, list) else [source]
    return ModelFile(
        model=model,
        std=std,
        sample_time=sample_time,
        source=tuple(_mapping(entry, "source") for entry in entries),
    )


def _numbers(
    given: Mapping[str, Any], specs: tuple[Any, ...], where: str, prefix: str, std: dict[str, float | None]
) -> dict[str, float]:
    """The numbers of one group of parameters; each entry is a number or {"value": .., "std": ..}."""
    unknown = set(given) - {spec.name for spec in specs}
    if unknown:
        known = ", ".join(spec.name for spec in specs)
        raise BadModelFile(f"{where}: unknown parameter {min(unknown)!r}; known are {known}.")
    numbers = {}
    for spec in specs:
        if spec.name not in given:
            if not spec.fitted:  # an older file, of when nobody could state it: the effect's own
                continue
            raise BadModelFile(f"{where}: parameter {spec.name!r} is missing.")
        entry = given[spec.name]
        value = entry.get("value") if isinstance(entry, Mapping) else entry
        if value is None or not _is_number(value):
            raise BadModelFile(f"{where}: {spec.name} must be a finite number, not {value!r}.")
        numbers[spec.name] = float(value)
        error = entry.get("std") if isinstance(entry, Mapping) else None
        std[prefix + spec.name] = float(error) if error is not None and _is_number(error) else None
    return numbers


def _mapping(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise BadModelFile(f"{where} must be an object with named entries.")
    return value


def _is_number(value: Any) -> bool:
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False
