"""The format of a file, by the suffix of its name."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from plant.errors import BadParameter


def check_format(path: Path, suffixes: Sequence[str], *, option: str = "path") -> None:
    """Raise `BadParameter` if the suffix of a file stands for another format than those that are written.

    Args:
        path: of the file; without a suffix it has any format.
        suffixes: of the formats; none allows any.
        option: name of the option or the argument that has the path.
    """
    if suffixes and path.suffix.lower() not in ("", *suffixes):
        base = path.with_suffix("")
        base = base.with_suffix("") if base.suffix.lower() in suffixes else base  # p.csv.gz
        *names, last = (f"{base.name}{suffix}" for suffix in suffixes)
        named = f"{', '.join(names)} or {last}" if names else last
        raise BadParameter(f"{option} {path}: {path.suffix} is not a format that is written here; name it {named}.")
