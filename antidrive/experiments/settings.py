"""Settings of an experiment from a scenario file, with every key checked against the fields of their class."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any, TypeGuard, TypeVar

from antidrive.scenario import keys_like
from plant.errors import BadParameter
from plant.rig import Rig

Settings = TypeVar("Settings")
RIG_FIELDS = tuple(field.name for field in fields(Rig) if field.name not in ("gears", "drives"))
_MOST_SAMPLES = 200_000


def read_settings(kind: type[Settings], name: str, content: Mapping[str, Any]) -> Settings:
    """Settings of a class whose fields are text, numbers, lists of numbers or the table [rig].

    Raises:
        BadParameter: an unknown key, a missing one, or a value that cannot be used.
    """
    known = {field.name: field for field in fields(kind)}  # type: ignore[arg-type]
    unknown = sorted(set(content) - set(known) - {"kind"})
    if unknown:
        named = keys_like(unknown[0], tuple(known))
        raise BadParameter(f"{name}: the file has the unknown key {unknown[0]!r}; {named}.")
    values = {}
    for key, field in known.items():
        if key in content:
            values[key] = _value(name, key, str(field.type), content[key])
        elif field.default is MISSING:
            raise BadParameter(f"{name}: {key} is missing.")
    try:
        return kind(**values)
    except BadParameter as error:
        raise BadParameter(f"{name}: {error}") from None


def need_positive(settings: object, *names: str) -> None:
    """Raise if one of these numbers is not above zero."""
    for name in names:
        value = getattr(settings, name)
        if not all(each > 0.0 for each in (value if isinstance(value, tuple) else (value,))):
            raise BadParameter(f"{name} must be above zero, not {value!r}.")


def need_samples(duration: float, sample_time: float) -> None:
    """Raise for a duration that is too few or too many samples."""
    if not 10 <= duration / sample_time <= _MOST_SAMPLES:
        raise BadParameter(f"duration must be between 10 and {_MOST_SAMPLES} samples of sample_time.")


def _value(name: str, key: str, expected: str, value: Any) -> Any:
    if expected == "str" and isinstance(value, str):
        return value
    if expected == "float" and _is_number(value):
        return float(value)
    if expected == "int" and isinstance(value, int) and not isinstance(value, bool):
        return value
    if expected.startswith("tuple") and _are_numbers(value):
        return tuple(float(each) for each in value)
    if expected.startswith("Mapping") and isinstance(value, dict):
        return {rig_key: _rig_value(name, rig_key, given) for rig_key, given in value.items()}
    wanted = {"str": "a text", "float": "a finite number", "int": "a whole number"}.get(expected, "a list of numbers")
    raise BadParameter(
        f"{name}: {key} must be {'a table' if expected.startswith('Mapping') else wanted}, not {value!r}."
    )


def _rig_value(name: str, key: str, value: Any) -> float | tuple[float, ...]:
    if key not in RIG_FIELDS:
        raise BadParameter(f"{name}: rig has the unknown key {key!r}; {keys_like(key, RIG_FIELDS)}.")
    if key == "backlash" and _are_numbers(value):
        return tuple(float(each) for each in value)
    if not _is_number(value):
        raise BadParameter(f"{name}: rig.{key} must be a finite number, not {value!r}.")
    return value


def _are_numbers(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(_is_number(each) for each in value)


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
