"""Provenance of a result, to reproduce it."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

from antidrive.version import VERSION
from identification.log import Source

_LIBRARIES = ("casadi", "numpy", "scipy")


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Command, versions and files of a result.

    Attributes:
        command: as typed, or an equivalent one.
        versions: name and version of each package that computes.
        sources: files with their hashes.
    """

    command: str
    versions: tuple[tuple[str, str], ...]
    sources: tuple[Source, ...] = ()

    @classmethod
    def now(cls, command: Sequence[str], sources: Sequence[Source] = ()) -> Provenance:
        """Provenance of this run."""
        versions = [("Python", platform.python_version()), ("antidrive", VERSION)]
        for name in _LIBRARIES:
            try:
                versions.append((name, version(name)))
            except PackageNotFoundError:
                versions.append((name, "not installed"))
        return cls(command=shlex.join(command), versions=tuple(versions), sources=tuple(dict.fromkeys(sources)))
