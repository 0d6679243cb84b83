"""Read a file into a table of named columns, without checks: the content decides the file type, not the name."""

from __future__ import annotations

import hashlib
import importlib
import sys
from pathlib import Path
from typing import cast

from identification.errors import MalformedLog
from identification.reading.formats.compression import unpacked
from identification.reading.formats.damaged_files import Read, guarded
from identification.reading.formats.lerobot import with_motor_names
from identification.reading.formats.long_tables import with_channels
from identification.reading.joints import with_joints
from identification.reading.table import Table

STANDARD_INPUT = "-"
SUFFIXES = {  # type of a file that has no known signature and is not text
    ".arrow": "Feather",
    ".feather": "Feather",
    ".h5": "HDF5",
    ".hdf": "HDF5",
    ".hdf5": "HDF5",
    ".mat": "MAT",
    ".mcap": "MCAP",
    ".mf4": "MF4",
    ".npy": "NPY",
    ".npz": "NPZ",
    ".parquet": "Parquet",
    ".pq": "Parquet",
    ".tdms": "TDMS",
    ".xlsx": "Excel",
}
_SIGNATURES = (
    (b"PAR1", "Parquet"),
    (b"ARROW1", "Feather"),
    (b"FEA1", "Feather"),
    (b"\x89HDF\r\n\x1a\n", "HDF5"),
    (b"MATLAB", "MAT"),
    (b"\x93NUMPY", "NPY"),
    (b"MDF     ", "MF4"),
    (b"TDSm", "TDMS"),
    (b"\x89MCAP", "MCAP"),
)
_READERS = {
    "Excel": ("excel", "read_excel"),
    "Feather": ("frames", "read_feather"),
    "HDF5": ("hdf5", "read_hdf5"),
    "MAT": ("arrays", "read_mat"),
    "MCAP": ("ros_bags", "read_mcap"),
    "MF4": ("mdf_tdms", "read_mf4"),
    "NPY": ("arrays", "read_npy"),
    "NPZ": ("arrays", "read_npz"),
    "Parquet": ("frames", "read_parquet"),
    "TDMS": ("mdf_tdms", "read_tdms"),
}
_LONGEST_LINE = 256  # of a log in text
_PICKLE = "a pickle, which may run any program and is never loaded; save the data as .parquet or .csv"
_FOREIGN = (
    (b"SQLite format 3\0", "a SQLite database; a ROS 2 bag is read as MCAP, which ros2 bag convert writes"),
    (b"#ROSBAG V", "a ROS 1 bag; write its topic as text with rostopic echo -p -b FILE /joint_states > log.csv"),
    (b"\xd0\xcf\x11\xe0", "an Excel file of before 2007; save it as .xlsx or .csv"),
    (
        b"LOGG",
        "a raw recording of a CAN bus (BLF); decode it with the .dbc of the bus, as asammdf does, to .mf4 or .csv",
    ),
    (b"ULog", "a log of PX4; convert it with ulog2csv"),
    *((bytes((0x80, protocol)), _PICKLE) for protocol in range(2, 6)),
)


def read_table(path: str | Path) -> Table:
    """Read one file, or standard input where the path is "-".

    Text tables, JSON and JSON lines, Parquet, Feather, MAT (v4 to v7.3), HDF5, NPZ, NPY, Excel, MF4, TDMS and MCAP;
    also compressed with gzip, bzip2, xz or zip. A matrix of k columns named `data` becomes `data:1` to `data:k`.

    Raises `MalformedLog` when the file is missing, of another kind, or unreadable.
    """
    path = Path(path)
    content = _bytes(path)
    name = "standard input" if str(path) == STANDARD_INPUT else path.name
    if not content:
        raise MalformedLog(f"{name}: the file is empty, export the log again.")
    digest = hashlib.sha256(content).hexdigest()
    content, kind = unpacked(content, name)
    suffix = next((s for s in reversed(Path(name.lower()).suffixes) if s in SUFFIXES), "")
    kind = kind or next((kind for signature, kind in _SIGNATURES if content.startswith(signature)), "")
    if not kind and not _is_text(content):
        kind = SUFFIXES.get(suffix, "")
        _refuse_foreign(content, name, known=bool(kind))
    if kind:
        module, function = _READERS[kind]
        read = cast(Read, getattr(importlib.import_module(f"identification.reading.formats.{module}"), function))
        table = guarded(read, content, name, digest, kind)
    else:
        from identification.reading.formats.json_tables import parse_json
        from identification.reading.formats.text import parse_text

        table = parse_json(content, name, digest) or parse_text(content, name, digest)
    return with_joints(with_motor_names(with_channels(table), path))


def _bytes(path: Path) -> bytes:
    if str(path) == STANDARD_INPUT:
        if sys.stdin.isatty():
            raise MalformedLog("standard input: nothing is piped into it, name a file or pipe a log.")
        return sys.stdin.buffer.read()
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise MalformedLog(f"{path}: there is no such file, check the path.") from error
    except IsADirectoryError as error:
        inside = sorted(file.name for file in path.iterdir() if file.suffix.lower() in {*SUFFIXES, ".csv", ".json"})
        example = f", such as {path / inside[0]}" if inside else ""
        raise MalformedLog(f"{path}: a folder cannot be opened as a log, name a file in it{example}.") from error
    except OSError as error:
        raise MalformedLog(f"{path}: the file cannot be opened ({error.strerror}), check it.") from error


def _is_text(content: bytes) -> bool:
    """Whether the first bytes are text; UTF-16 needs its byte order mark, and the first line may be garbled."""
    head = content[:4096]
    first = head.find(b"\n", 0, _LONGEST_LINE) + 1
    control = head[first:].translate(None, bytes(range(32, 256)) + b"\t\n\r\f\v\x1b\x1a")
    return content[:2] in (b"\xff\xfe", b"\xfe\xff") or not (control or _foreign(content))


def _foreign(content: bytes) -> str:
    return next((what for signature, what in _FOREIGN if content.startswith(signature)), "")


def _refuse_foreign(content: bytes, name: str, *, known: bool) -> None:
    what = _foreign(content)
    if what:
        raise MalformedLog(f"{name}: this is {what}.")
    if not known:
        raise MalformedLog(
            f"{name}: this is not a text table, nor in another known format: JSON, {', '.join(sorted(_READERS))}."
        )
