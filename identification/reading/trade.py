"""Binary logs of the trade: MF4 (ASAM MDF), TDMS (LabVIEW) and MCAP (robotics): channels with clocks and units.

Each is read by the library of its format, which is imported only here: `pip install 'antidrive[logs]'`.
"""

from __future__ import annotations

import gc
import io
import json
import logging
import sys
from array import array
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identification.errors import MalformedLog
from identification.reading.table import Table
from identification.recording import Array

_LIBRARIES = {".mf4": "asammdf", ".tdms": "npTDMS", ".mcap": "mcap"}
_TDMS_UNITS = ("unit_string", "NI_UnitDescription", "Unit", "unit")
_MF4_NUMBERS = range(6)  # data types: integers and floats, in either byte order
_MF4_VALUES = (0, 6)  # channel types: fixed length, virtual
_MF4_VIRTUAL = (3, 6)  # channel types without bytes in the record
_MF4_TIME = 1  # what a master channel may measure: time, and not angle, distance or index


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel:
    """One channel: samples of any dtype, their times [s] if it has any, its unit as the file writes it."""

    group: str
    name: str
    values: NDArray[Any]
    time: Array | None
    unit: str


def read_trade(content: bytes, file: str, sha256: str) -> Table:
    """Read an MF4, TDMS or MCAP file by its suffix.

    Raises `MalformedLog` when its library is not installed, the file is damaged, or holds no numbers.
    """
    suffix = Path(file).suffix.lower()
    read = {".mf4": _mf4, ".tdms": _tdms, ".mcap": _mcap}[suffix]
    problem = ""
    channels: list[Channel] = []
    notes: list[str] = []
    with _quiet(), redirect_stdout(io.StringIO()):
        try:
            channels = list(read(content, notes))
        except ImportError:
            problem = f"{suffix} files are read by {_LIBRARIES[suffix]}, install it with pip install 'antidrive[logs]'"
        except MalformedLog as error:
            problem = str(error)
        except Exception as error:  # each library raises whatever a damaged file leads it to
            problem = f"not a readable {suffix} file ({type(error).__name__}), export the log again"
        if problem and suffix == ".mf4":
            gc.collect()  # what asammdf could not open goes now, while nobody hears its finaliser fail
    if not problem and not channels:
        problem = "the file holds no numeric columns, export the log again"
    if problem:
        raise MalformedLog(f"{file}: {problem}.")
    named = dict(reversed([*zip(_names(channels), channels, strict=True)]))  # of one name, the first counts
    return Table(
        name=file,
        columns={name: channel.values for name, channel in named.items()},
        sha256=sha256,
        notes=tuple(f"{file}: {note}" for note in notes),
        clocks={name: channel.time for name, channel in named.items() if channel.time is not None},
        units={name: channel.unit for name, channel in named.items() if channel.unit},
    )


def _names(channels: list[Channel]) -> list[str]:
    """A channel's own name where it is the only one so called, else with its group before it."""
    times = Counter(channel.name for channel in channels)
    return [c.name if times[c.name] == 1 else f"{c.group}/{c.name}" for c in channels]


@contextmanager
def _quiet() -> Iterator[None]:
    """The libraries log what they meet to stderr, and asammdf's finaliser fails on a file that it could not open."""
    disabled, hook = logging.root.manager.disable, sys.unraisablehook
    logging.disable(logging.CRITICAL)
    sys.unraisablehook = lambda _: None
    try:
        yield
    finally:
        logging.disable(disabled)
        sys.unraisablehook = hook


def _mf4(content: bytes, notes: list[str]) -> Iterator[Channel]:
    from asammdf import MDF

    with MDF(io.BytesIO(content)) as file:
        clock: Array = np.empty(0)
        group: Any
        for g, group in enumerate(file.groups):
            _check_record(group)
            master = file.masters_db.get(g)
            timed = master is not None and group.channels[master].sync_type == _MF4_TIME
            for c, channel in enumerate(group.channels):
                if c == master or channel.channel_type not in _MF4_VALUES or channel.data_type not in _MF4_NUMBERS:
                    continue
                signal = file.get(group=g, index=c)
                if signal.samples.ndim != 1 or signal.samples.dtype.kind not in "fiub" or len(signal.samples) < 2:
                    continue
                if not np.array_equal(clock, signal.timestamps):
                    clock = np.asarray(signal.timestamps, dtype=np.float64)
                yield Channel(
                    group=group.channel_group.acq_name or f"{g}",
                    name=channel.name,
                    values=signal.samples,
                    time=clock if timed else None,
                    unit=signal.unit,
                )


def _check_record(group: Any) -> None:
    """Refuse a channel beyond its record: asammdf would read foreign memory, and Python crash."""
    for channel in group.channels:
        if channel.channel_type in _MF4_VIRTUAL:
            continue
        bits = 8 * channel.byte_offset + channel.bit_offset + channel.bit_count
        if bits > 8 * group.channel_group.samples_byte_nr:
            raise ValueError(channel.name)


def _tdms(content: bytes, notes: list[str]) -> Iterator[Channel]:
    from nptdms import TdmsFile

    file = TdmsFile.read(io.BytesIO(content))
    if file.file_status.incomplete_final_segment or file.file_status.channel_statuses:
        notes.append("the file is cut off, and read up to there")
    channels = [c for group in file.groups() for c in group.channels() if c.dtype.kind in "fiubM" and len(c) > 1]
    starts = [c.properties["wf_start_time"] for c in channels if "wf_start_time" in c.properties]
    clock: Array = np.empty(0)
    for channel in channels:
        said = channel.properties
        step = float(said.get("wf_increment", 0.0))
        time: Array | None = None
        if step > 0:
            late = (said["wf_start_time"] - min(starts)) / np.timedelta64(1, "s") if "wf_start_time" in said else 0.0
            time = float(late) + float(said.get("wf_start_offset", 0.0)) + step * np.arange(len(channel), dtype=float)
            clock = time = clock if np.array_equal(clock, time) else time
        yield Channel(
            group=channel.group_name,
            name=channel.name,
            values=channel[:],
            time=time,
            unit=str(next((said[key] for key in _TDMS_UNITS if key in said), "")),
        )


def _mcap(content: bytes, notes: list[str]) -> Iterator[Channel]:
    from mcap.reader import make_reader

    clocks: dict[str, array[int]] = {}
    fields: dict[str, dict[str, array[float]]] = {}
    unread: dict[str, str] = {}
    for _, source, message in make_reader(io.BytesIO(content), validate_crcs=True).iter_messages():
        if source.message_encoding != "json":
            unread[source.topic] = source.message_encoding or "unknown"
            continue
        clock = clocks.setdefault(source.topic, array("q"))
        known = fields.setdefault(source.topic, {})
        for name, value in _numbers(json.loads(message.data)):
            values = known.setdefault(name, array("d"))
            values.extend([np.nan] * (len(clock) - len(values)))  # it was not in the messages before
            values.append(value)
        clock.append(message.log_time)
    if unread:
        listed = ", ".join(f"'{topic}' ({encoding})" for topic, encoding in unread.items())
        told = f"only messages encoded as json are read, not those of {listed}"
        if not fields:
            raise MalformedLog(f"{told}; export the log as CSV or with json messages")
        notes.append(told)
    start = min((clock[0] for clock in clocks.values()), default=0)
    for topic, clock in clocks.items():
        time = (np.asarray(clock) - start) * 1e-9  # log_time, in nanoseconds
        for name, values in fields[topic].items():
            values.extend([np.nan] * (len(clock) - len(values)))
            yield Channel(group=topic, name=f"{topic}.{name}", values=np.asarray(values), time=time, unit="")


def _numbers(message: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """The numbers of a message with their paths: `position`, `drive.torque`, of a list `torque:1`, `torque:2`."""
    if isinstance(message, dict):
        for key, value in message.items():
            yield from _numbers(value, f"{name}.{key}" if name else key)
    elif isinstance(message, list):
        for k, value in enumerate(message):
            yield from _numbers(value, f"{name}:{k + 1}")
    elif isinstance(message, int | float):
        yield name, float(message)
