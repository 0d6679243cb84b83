"""Bags of robots as MCAP: messages in JSON, and those of ROS 2 in CDR; each topic has its clock."""

from __future__ import annotations

import io
import json
from array import array
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from identification.errors import MalformedLog
from identification.reading.formats.channels import Channel, table_of
from identification.reading.formats.messages import gathered
from identification.reading.table import Table
from identification.recording import Array

_LARGEST = 1 << 16  # bytes of a message; a larger one is a picture or a point cloud


@dataclass(kw_only=True)
class _Topic:
    """Messages of one topic; times of logging and, if their headers have them, time stamps [ns]."""

    messages: list[Any] = field(default_factory=list)
    logged: array[int] = field(default_factory=lambda: array("q"))
    stamped: array[int] = field(default_factory=lambda: array("q"))

    @property
    def has_stamps(self) -> bool:
        """Whether every message has a time stamp, and they never decrease."""
        return len(self.stamped) == len(self.logged) and min(self.stamped) > 0 and not np.any(np.diff(self.stamped) < 0)


class _Unknown(Exception):
    """The messages of a topic are in an encoding that has no decoder."""


def read_mcap(content: bytes, name: str, sha256: str) -> Table:
    """The numbers in the messages of each topic, as `/topic.field`; for lists with names `/topic.position:elbow`.

    Raises `MalformedLog` if no message has a readable encoding.
    """
    notes: list[str] = []
    return table_of(list(_channels(_topics(content, notes))), name, sha256, notes)


def _topics(content: bytes, notes: list[str]) -> dict[str, _Topic]:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    topics: dict[str, _Topic] = defaultdict(_Topic)
    unread: dict[str, str] = {}
    factory = DecoderFactory()
    for schema, source, message in make_reader(io.BytesIO(content), validate_crcs=True).iter_messages():
        if len(message.data) > _LARGEST or source.topic in unread:
            continue
        try:
            decoded, stamp = _decoded(message.data, source.message_encoding, schema, factory)
        except Exception as error:  # from an unsupported definition; other topics may be valid
            why = "" if isinstance(error, _Unknown) else ", which cannot be decoded"
            unread[source.topic] = f"{source.message_encoding or 'unknown'}{why}"
            topics.pop(source.topic, None)
            continue
        topic = topics[source.topic]
        topic.messages.append(decoded)
        topic.logged.append(message.log_time)
        if stamp:
            topic.stamped.append(stamp)
    if unread:
        listed = ", ".join(f"'{topic}' ({why})" for topic, why in unread.items())
        reason = f"messages in json, and those of ROS 2 with their definitions, are read, but not those of {listed}"
        if not topics:
            raise MalformedLog(f"{reason}; export the log as CSV or with json messages")
        notes.append(reason)
    return topics


def _decoded(data: bytes, encoding: str, schema: Any, factory: Any) -> tuple[Any, int]:
    """A message and its time stamp [ns], 0 without one; raises `_Unknown` if the encoding has no decoder."""
    if encoding == "json":
        return json.loads(data), 0
    decode = factory.decoder_for(encoding, schema)
    if decode is None:
        raise _Unknown
    message = decode(data)
    return message, _without_header(message)


def _without_header(message: Any) -> int:
    """The time stamp of a message's header [ns], 0 without one; a header with a stamp is removed from the message."""
    header = getattr(message, "header", None)
    stamp = getattr(header, "stamp", None)
    if stamp is None:
        return 0
    del message.header
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def _channels(topics: dict[str, _Topic]) -> Iterator[Channel]:
    """Each topic with its time stamps, shifted to the clock of the log by one common offset, else as logged."""
    stamped = [topic for topic in topics.values() if topic.has_stamps]
    late = [np.asarray(topic.logged) - np.asarray(topic.stamped) for topic in stamped]
    shift = int(np.median(np.concatenate(late))) if late else 0
    clocks = {
        key: np.asarray(topic.stamped) + shift if topic.has_stamps else np.asarray(topic.logged)
        for key, topic in topics.items()
    }
    start = min((int(clock.min()) for clock in clocks.values()), default=0)
    for key, topic in topics.items():
        time: Array = (clocks[key] - start) * 1e-9
        found = gathered(topic.messages, text=False)
        for path, values in found.columns.items():
            joint = found.joint_of.get(path)
            yield Channel(
                group=key,
                name=f"{key}.{path}",
                values=values,
                time=time,
                joint=None if joint is None else (joint[0], f"{key}.{joint[1]}"),
            )
