"""Files that are kept from one program to the next, in the user's cache folder.

Each has the hash of its content as its name: one that was cut short is noticed and thrown away. So is what nobody has
used for a long time, such as that of an older version, and what has been used longest ago where there is very much.
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
_MOST = 10_000  # folders, of 50 kB in the mean


def mark(content: bytes) -> str:
    """A name that two contents have in common only if they are the same."""
    return hashlib.sha256(content).hexdigest()[:24]


def kept(folder: str, ending: str) -> Path | None:
    """The whole file in a folder of the cache; None where there is none, or none that can be read."""
    try:
        for path in (_cache() / folder).glob(f"*.{ending}"):
            if path.stem == mark(path.read_bytes()):
                with suppress(OSError):  # not ours to write
                    os.utime(path.parent)
                return path
            path.unlink()
    except OSError:
        pass
    return None


def keep(folder: str, content: bytes, ending: str) -> None:
    """Write a file in one step, so that no other process sees half of it.

    Raises:
        OSError: the cache cannot be written.
    """
    place = _cache() / folder
    place.mkdir(parents=True, exist_ok=True)
    _swept(place.parent)
    beside = place / f"{os.getpid()}-{threading.get_ident()}"
    with beside.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())  # else the new name may outlive a power cut, and the content not
    os.replace(beside, place / f"{mark(content)}.{ending}")


@lru_cache(maxsize=1)
def _swept(root: Path) -> None:
    """Throw away what nobody has used for long, and more than can be of use, once in a program."""
    with suppress(OSError):
        used = sorted(((folder.stat().st_mtime, folder) for folder in root.iterdir()), reverse=True)
        for place, (when, folder) in enumerate(used):
            if place >= _MOST or when < time.time() - _LONG:
                shutil.rmtree(folder, ignore_errors=True)


def _cache() -> Path:
    return user_cache_path("antidrive")
