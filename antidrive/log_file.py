"""log.toml: the interpretation of a log in a file, so that no option need be typed again.

files = ["log.csv"]          # in the same folder; `holdout` likewise, validation logs
gears = "20,20:161"          # also ratio, rate, torque_constant, kp, kd, joint

[columns]
angle = "Angle (deg)"
[units]
angle = "deg"
[scale]
torque = -1.0
[fit]                        # see `antidrive.fit_options.FitOptions.of`
exclude = ["backlash"]
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from antidrive.fit_options import FitOptions
from antidrive.log_options import NUMBERS, LogOptions
from identification.log import Log
from plant.errors import BadParameter

_HEAD = (
    "# How this log is read. Correct it where it is wrong, and give it in place of the log: antidrive diagnose log.toml"
)
_TEXTS = ("gears", "ratio", "joint")
_TABLES = ("columns", "units", "scale", "fit")
_KEYS = ("files", "holdout", *_TEXTS, *NUMBERS, *_TABLES)


def read_log(path: str | Path) -> Log:
    """Read the log that a log.toml of `antidrive inspect` describes, or any other log file.

    Raises:
        BadParameter: the log.toml is missing, is no TOML, or has a key or value that it cannot have.
        MalformedLog: a log file that cannot be used.
    """
    path = Path(path)
    return read_log_file(path).read().log if path.suffix.lower() == ".toml" else Log.read(path)


def read_log_file(path: Path) -> LogOptions:
    """The options in a log.toml, with file paths relative to its folder.

    Raises:
        BadParameter: it is missing, no TOML, or has an unknown key or an unusable value.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise BadParameter(f"{path}: the file cannot be opened ({error.strerror}); check the path.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadParameter(
            f"{path.name}: this is no TOML ({error}); correct it, or run `antidrive inspect` again."
        ) from None
    unknown = sorted(set(content) - set(_KEYS))
    if unknown:
        raise BadParameter(f"{path.name} has no {unknown[0]!r}; it may have {', '.join(_KEYS)}.")
    for key in _TABLES:
        if not isinstance(content.get(key, {}), Mapping):
            raise BadParameter(f"{path.name}: {key} is not a table; write [{key}] above its lines.")
    folder = path.parent
    files = _paths(path, content, "files")
    if not files:
        raise BadParameter(f'{path.name}: files is empty; name the log, as in files = ["log.csv"].')
    return LogOptions(
        files=files,
        holdout=_paths(path, content, "holdout"),
        mapping={column: str(name) for column, name in content.get("columns", {}).items()},
        units={column: str(unit) for column, unit in content.get("units", {}).items()},
        scales={
            column: _number(path, f"scale of {column}", value) for column, value in content.get("scale", {}).items()
        },
        **_single(path, content),
        fit=FitOptions.of(content.get("fit", {}), folder),
    )


def log_file(options: LogOptions, folder: Path, columns: Mapping[str, str], units: Mapping[str, str]) -> str:
    """The text of a log.toml in a folder.

    Args:
        options: options with which the log was read.
        folder: of the file; paths are relative to it.
        columns, units: the interpretation, by column of the log contract.
    """
    import tomli_w

    content: dict[str, Any] = {"files": _named_from(folder, options.files)}
    if options.holdout:
        content["holdout"] = _named_from(folder, options.holdout)
    for key in (*_TEXTS, *NUMBERS):
        if (value := getattr(options, key)) is not None:
            content[key] = value
    content["columns"] = dict(columns)
    content["units"] = {**units, **options.units}
    if options.scales:
        content["scale"] = dict(options.scales)
    return f"{_HEAD}\n{tomli_w.dumps(content)}"


def _paths(path: Path, content: Mapping[str, Any], key: str) -> tuple[Path, ...]:
    given = content.get(key, [])
    given = [given] if isinstance(given, str) else given
    if not (isinstance(given, list) and all(isinstance(name, str) for name in given)):
        raise BadParameter(f'{path.name}: {key} must be a list of paths, as in {key} = ["log.csv"].')
    return tuple(path.parent / name for name in given)


def _single(path: Path, content: Mapping[str, Any]) -> dict[str, Any]:
    texts = {key: str(content[key]) for key in _TEXTS if key in content}
    return texts | {key: _number(path, key, content[key]) for key in NUMBERS if key in content}


def _number(path: Path, key: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise BadParameter(f"{path.name}: {key} is {value!r}, it must be a number.")
    return float(value)


def _named_from(folder: Path, paths: Sequence[Path]) -> list[str]:
    """Paths relative to a folder; those on another disk are absolute."""
    found = []
    for path in paths:
        try:
            found.append(Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix())
        except ValueError:
            found.append(str(path.resolve()))
    return found
