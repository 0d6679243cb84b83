"""Convert channels with one clock each, as of recorders and robots, to one table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from identification.reading.table import Table
from identification.recording import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel:
    """One channel: samples of any dtype, their times [s] if there are any, its unit as in the file.

    joint: its joint and its name without the joint, if it belongs to one.
    """

    group: str
    name: str
    values: NDArray[Any]
    time: Array | None
    unit: str = ""
    joint: tuple[str, str] | None = None


def table_of(channels: Sequence[Channel], name: str, sha256: str, notes: Sequence[str] = ()) -> Table:
    """The table of channels by name; a name that occurs several times is prefixed by the group."""
    times = Counter(channel.name for channel in channels)
    named: dict[str, Channel] = {}
    for channel in channels:  # the first of a name is used
        named.setdefault(channel.name if times[channel.name] == 1 else f"{channel.group}/{channel.name}", channel)
    return Table(
        name=name,
        columns={key: channel.values for key, channel in named.items()},
        sha256=sha256,
        notes=tuple(f"{name}: {note}" for note in notes),
        clocks={key: channel.time for key, channel in named.items() if channel.time is not None},
        units={key: channel.unit for key, channel in named.items() if channel.unit},
        joint_of={key: channel.joint for key, channel in named.items() if channel.joint is not None},
    )
