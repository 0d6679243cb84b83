"""The version of antidrive: of the installed distribution, or of the source tree that runs uninstalled."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version


def _in_the_source_tree() -> str:
    import tomllib
    from pathlib import Path

    try:
        text = (Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8")
    except OSError:  # copied out of its tree
        return "unknown"
    return str(tomllib.loads(text)["project"]["version"])


def _found() -> str:
    try:
        return version("antidrive")
    except PackageNotFoundError:
        return _in_the_source_tree()


VERSION = _found()
