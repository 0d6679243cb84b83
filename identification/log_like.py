"""The types that are accepted as a log: a file, several files, a table, arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, cast

from numpy.typing import ArrayLike

from identification.log import Log
from plant.errors import BadParameter

if TYPE_CHECKING:
    import pandas as pd

LogLike: TypeAlias = "Log | str | Path | Sequence[str | Path] | pd.DataFrame | Mapping[str, ArrayLike]"


def log_of(source: LogLike) -> Log:
    """The log itself, or one read from a path or several, a DataFrame, or arrays by name.

    Raises:
        BadParameter: the source is of another type.
        MalformedLog: the log cannot be used.
    """
    if isinstance(source, Log):
        return source
    if isinstance(source, str | Path):
        return Log.read(source)
    if isinstance(source, Mapping):
        arrays: dict[str, Any] = dict(source)
        return Log.from_arrays(**arrays)
    if hasattr(source, "columns") and hasattr(source, "to_numpy"):
        return Log.from_dataframe(cast("pd.DataFrame", source))
    if isinstance(source, Sequence) and source and all(isinstance(each, str | Path) for each in source):
        return Log.read(source)
    raise BadParameter(
        "This needs a log: pass a path or several, a DataFrame, arrays by name as in "
        f'{{"time": t, "torque": u, "angle": y}}, or an identification.Log, not {_kind(source)}.'
    )


def _kind(source: object) -> str:
    name = type(source).__name__
    return f"{'an' if name[0] in 'aeiouAEIOU' else 'a'} {name}"
