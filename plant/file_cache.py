"""Files cached between programs, in the user's cache folder.

The name of each file is the hash of its content: a truncated one is recognised and deleted. Files that have not been
used for a long time, such as those of an older version, are deleted; so are the least recently used ones if there are
very many.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import threading
import time
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from platformdirs import user_cache_path

_LONG = 90 * 86400.0  # [s]
_MOST = 10_000  # folders, of 50 kB on average


def content_hash(content: bytes) -> str:
    """Hash of a content, used as a name."""
    return hashlib.sha256(content).hexdigest()[:24]


def kept(folder: str, ending: str) -> Path | None:
    """The complete file in a folder of the cache; None if there is none, or none that can be read."""
    try:
        for path in (_cache() / folder).glob(f"*.{ending}"):
            if path.stem == content_hash(path.read_bytes()):
                with suppress(OSError):  # no permission to write
                    os.utime(path.parent)
                return path
            path.unlink()
    except OSError:
        pass
    return None


def keep(folder: str, content: bytes, ending: str) -> None:
    """Write a file atomically, so that no other process reads a part of it.

    Raises:
        OSError: the cache cannot be written.
    """
    place = _cache() / folder
    place.mkdir(parents=True, exist_ok=True)
    _swept(place.parent)
    beside = place / f"{os.getpid()}-{threading.get_ident()}"
    with beside.open("wb") as file:
        file.write(content)  # after a power failure it may be incomplete, as a reader sees by the hash
    os.replace(beside, place / f"{content_hash(content)}.{ending}")


@lru_cache(maxsize=1)
def _swept(root: Path) -> None:
    """Delete what has not been used for long, and the least recently used above a number, once in a program."""
    with suppress(OSError):
        used = sorted(((folder.stat().st_mtime, folder) for folder in root.iterdir()), reverse=True)
        for place, (when, folder) in enumerate(used):
            if place >= _MOST or when < time.time() - _LONG:
                shutil.rmtree(folder, ignore_errors=True)


def _cache() -> Path:
    return user_cache_path("antidrive")
