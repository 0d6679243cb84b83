"""Binary logs MF4 (ASAM MDF) and TDMS (LabVIEW): channels with clocks and units.

The library of each format reads it; these are imported only here: `pip install 'antidrive[logs]'`.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any

import numpy as np

from identification.reading.formats.channels import Channel, table_of
from identification.reading.table import Table
from identification.recording import Array

_TDMS_UNITS = ("unit_string", "NI_UnitDescription", "Unit", "unit")
_MF4_NUMBERS = range(6)  # data types: integers and floats, in either byte order
_MF4_VALUES = (0, 6)  # channel types: fixed length, virtual
_MF4_VIRTUAL = (3, 6)  # channel types without bytes in the record
_MF4_TIME = 1  # type of a master channel: time, not angle, distance or index


def read_mf4(content: bytes, name: str, sha256: str) -> Table:
    """The numeric channels of an MF4 file, on the time of their group if it has one."""
    return table_of(list(_mf4(content)), name, sha256)


def read_tdms(content: bytes, name: str, sha256: str) -> Table:
    """The numeric channels of a TDMS file, with the time from their waveform properties, if there are any."""
    notes: list[str] = []
    return table_of(list(_tdms(content, notes)), name, sha256, notes)


def _mf4(content: bytes) -> Iterator[Channel]:
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
    """Raise an error for a channel beyond its record: asammdf would read invalid memory, and Python would crash."""
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
        properties = channel.properties
        step = float(properties.get("wf_increment", 0.0))
        time: Array | None = None
        if step > 0:
            late = (
                (properties["wf_start_time"] - min(starts)) / np.timedelta64(1, "s")
                if "wf_start_time" in properties
                else 0.0
            )
            time = (
                float(late)
                + float(properties.get("wf_start_offset", 0.0))
                + step * np.arange(len(channel), dtype=float)
            )
            clock = time = clock if np.array_equal(clock, time) else time
        yield Channel(
            group=channel.group_name,
            name=channel.name,
            values=channel[:],
            time=time,
            unit=str(next((properties[key] for key in _TDMS_UNITS if key in properties), "")),
        )
