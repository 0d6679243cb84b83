"""Data sets of LeRobot: the names of the motors are in `meta/info.json` in a folder above the Parquet files."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from identification.reading.table import Table

_LEVELS = 4  # data/chunk-000/episode_000000.parquet
_QUANTITIES = ("pos", "position", "vel", "velocity", "torque", "effort", "current", "acc")


def with_motor_names(table: Table, path: Path) -> Table:
    """The table with the names of motors, if the data set has them: `observation.state:elbow` for `:1`."""
    if not any(name.endswith(":1") for name in table.columns):
        return table
    info = next(
        (folder / "meta" / "info.json" for folder in _above(path) if (folder / "meta" / "info.json").is_file()), None
    )
    if info is None:
        return table
    try:
        features = json.loads(info.read_bytes())["features"]
        named = {feature: _names(value.get("names")) for feature, value in features.items()}
    except (
        OSError,
        ValueError,
        LookupError,
        TypeError,
        AttributeError,
        RecursionError,
    ):  # then the columns keep their numbers
        return table
    called: dict[str, str] = {}
    joint_of = dict(table.joint_of)
    for feature, names in named.items():
        columns = [f"{feature}:{k + 1}" for k in range(len(names))]
        if not names or f"{feature}:{len(names) + 1}" in table.columns or not set(columns) <= set(table.columns):
            continue
        for column, name in zip(columns, names, strict=True):
            joint, _, quantity = name.rpartition(".")
            if quantity not in _QUANTITIES:
                joint, quantity = name, ""
            called[column] = f"{feature}:{name}"
            joint_of[called[column]] = (joint, feature if quantity in ("", "pos") else f"{feature}.{quantity}")
    return replace(
        table, columns={called.get(name, name): values for name, values in table.columns.items()}, joint_of=joint_of
    )


def _above(path: Path) -> Iterator[Path]:
    yield from list(path.absolute().parents)[:_LEVELS]


def _names(value: Any) -> list[str]:
    """A list of names, or the one in `{"motors": [...]}`."""
    if isinstance(value, dict):
        value = next(iter(value.values()), None) if len(value) == 1 else None
    return value if isinstance(value, list) and all(isinstance(name, str) for name in value) else []
