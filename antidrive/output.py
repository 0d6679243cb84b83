"""Result files, written completely or not at all."""

from __future__ import annotations

import json
import math
import os
import shutil
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import numpy as np

from antidrive.interruption import unstoppable
from plant.errors import BadParameter
from plant.file_format import check_format

PAGES = (".html", ".htm")
"""Suffixes of a page."""

_FILES = (*PAGES, ".csv", ".json", ".toml", ".parquet", ".xlsx", ".c", ".h", ".xml", ".urdf", ".mo", ".fmu", ".zip")
"""Suffixes that no folder of results has."""

_WRITTEN: ContextVar[Path | None] = ContextVar("written", default=None)  # folder or file with results of this command


@contextmanager
def whole_folder(out: Path, *, replaced: Collection[str] = ()) -> Iterator[Path]:
    """A draft folder whose files move into `out` if the block succeeds, and are deleted otherwise.

    Args:
        out: the folder.
        replaced: files of an earlier run that do not stay beside the new results, even if there are no new ones.

    Raises:
        BadParameter: `out` is a file or is named like one, or cannot be written.
    """
    if out.exists() and not out.is_dir():
        raise BadParameter(f"--out {out}: is a file; name a folder.")
    if out.suffix.lower() in _FILES and not out.is_dir():
        raise BadParameter(f"--out {out}: is named like a file, and several are written; name a folder.")
    with _draft_beside(out) as draft:
        yield draft
        for made in draft.iterdir():
            if (out / made.name).is_dir():
                raise BadParameter(f"--out {out}: a folder named {made.name} is in the way of a result; move it away.")
        with unstoppable():
            out.mkdir(parents=True, exist_ok=True)
            for name in replaced:
                if not (draft / name).exists() and (out / name).is_file():
                    (out / name).unlink()
            for made in sorted(draft.iterdir()):
                os.replace(made, out / made.name)
                _WRITTEN.set(out)


@contextmanager
def whole_file(out: Path, *, option: str = "--out", suffixes: Sequence[str] = ()) -> Iterator[Path]:
    """A draft file that becomes `out` if the block succeeds, and is deleted otherwise.

    Args:
        out: the file.
        option: name of its command-line option.
        suffixes: of its format; any by default.

    Raises:
        BadParameter: `out` is a folder, has the suffix of another format, or cannot be written.
    """
    check_format(out, suffixes, option=option)
    if out.is_dir():
        raise BadParameter(f"{option} {out}: is a folder; name a file.")
    with _draft_beside(out, option) as draft:
        yield draft / out.name
        with unstoppable():
            out.parent.mkdir(parents=True, exist_ok=True)
            os.replace(draft / out.name, out)
            _WRITTEN.set(out)


def left() -> str:
    """State of the results when a command ends early, as the end of a sentence."""
    out = _WRITTEN.get()
    return "nothing was written" if out is None else f"the results are in {out}"


@contextmanager
def _draft_beside(out: Path, option: str = "--out") -> Iterator[Path]:
    """A temporary folder on the same disk as `out`, so that moving a file is a rename."""
    existing = next(folder for folder in out.absolute().parents if folder.exists())
    try:
        draft = Path(tempfile.mkdtemp(prefix=".antidrive-", dir=existing))
    except OSError as error:
        raise BadParameter(f"{option} {out}: cannot be written ({error.strerror}); choose another place.") from None
    try:
        yield draft
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def strict(value: Any) -> Any:
    """The same content in plain Python types, with null for NaN and infinity."""
    if isinstance(value, Mapping):
        return {str(key): strict(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray):
        return strict(value.tolist())
    if isinstance(value, list | tuple):
        return [strict(entry) for entry in value]
    if isinstance(value, np.generic):
        return strict(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def to_json(content: Any, *, ascii: bool = False) -> str:
    """Indented standard JSON; with `ascii` other characters are escaped with \\u."""
    return json.dumps(strict(content), indent=2, allow_nan=False, ensure_ascii=ascii)


def write_json(path: Path, content: Any) -> None:
    """Write one JSON file."""
    path.write_text(to_json(content) + "\n", encoding="utf-8")


def written(out: Path, files: str) -> str:
    """Message on the result files in a folder."""
    return f"Written to {out}: {files}"
