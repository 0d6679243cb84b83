"""Compressed files: gzip, bzip2, xz, and zip archives with one file in them."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import zipfile
from collections.abc import Callable

from identification.errors import MalformedLog

_STREAMS: tuple[tuple[bytes, str, Callable[[bytes], bytes]], ...] = (
    (b"\x1f\x8b", ".gz", gzip.decompress),
    (b"BZh", ".bz2", bz2.decompress),
    (b"\xfd7zXZ\0", ".xz", lzma.decompress),
)


def unpacked(content: bytes, name: str) -> tuple[bytes, str]:
    """The uncompressed content, and the format of a zip archive that is itself a log ("NPZ", "Excel"), else "".

    Raises `MalformedLog` if the file is damaged, or an archive of several files.
    """
    for signature, suffix, decompress in _STREAMS:
        if content.startswith(signature):
            try:
                return decompress(content), ""
            except Exception as error:  # OSError, EOFError, zlib.error, LZMAError, ...
                raise MalformedLog(
                    f"{name}: not a readable {suffix} file ({type(error).__name__}), it is damaged or cut off."
                ) from error
    if not content.startswith(b"PK\x03\x04"):
        return content, ""
    try:
        return _from_zip(content, name)
    except MalformedLog:
        raise
    except Exception as error:  # of an archive that is cut off, or encrypted
        kind = next((kind for kind in (".npz", ".xlsx") if name.lower().endswith(kind)), ".zip")
        raise MalformedLog(
            f"{name}: not a readable {kind} file ({type(error).__name__}), it is damaged or cut off."
        ) from error


def _from_zip(content: bytes, name: str) -> tuple[bytes, str]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [member for member in archive.namelist() if not member.endswith("/")]
        if "[Content_Types].xml" in members:
            return content, "Excel"
        if members and all(member.endswith(".npy") for member in members):
            return content, "NPZ"
        files = [member for member in members if not member.startswith("__MACOSX/")]
        if len(files) != 1:
            raise MalformedLog(f"{name}: the archive holds {len(files)} files, unpack it and name the log.")
        return archive.read(files[0]), ""
