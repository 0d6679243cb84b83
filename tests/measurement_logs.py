"""Logs of the trade, written by the libraries of their formats: what the tests of their readers share."""

from __future__ import annotations

import io
import json

import numpy as np
from asammdf import MDF, Signal
from mcap.writer import Writer
from nptdms import ChannelObject, TdmsWriter

START = np.datetime64("2026-03-01T10:00:00.250000")


def mf4(path, *groups, units=None, names=()):
    """Groups of columns, each with a time of its own under "time"."""
    units = units or {}
    with MDF(version="4.10") as file:
        for k, group in enumerate(groups):
            signals = [
                Signal(np.asarray(values), np.asarray(group["time"]), name=name, unit=units.get(name, ""))
                for name, values in group.items()
                if name != "time"
            ]
            file.append(signals, acq_name=names[k] if names else "")
        file.save(path, overwrite=True)
    return path


def tdms(path, *groups, units=None, waveform=True, segments=6):
    """Groups of columns; the time is either the waveform's start and increment, or a channel like any other."""
    units = units or {}
    with TdmsWriter(path) as file:
        for k in range(segments):
            objects = []
            for g, group in enumerate(groups):
                time = group["time"]
                for name, values in group.items():
                    if waveform and name == "time":
                        continue
                    properties = {"unit_string": units[name]} if name in units else {}
                    if waveform:
                        start = START + np.timedelta64(round(1e6 * time[0]), "us")
                        properties |= {"wf_start_time": start, "wf_increment": time[1] - time[0], "wf_samples": 1}
                    objects.append(ChannelObject(f"group {g}", name, np.array_split(values, segments)[k], properties))
            file.write_segment(objects)
    return path


def mcap(path, topics, encoding="json", other=()):
    """Topics of columns as messages, without what is not a number; `other` are topics that are not json."""
    content = io.BytesIO()
    file = Writer(content, chunk_size=4096)
    file.start()
    schema = file.register_schema(name="Sample", encoding="jsonschema", data=b'{"type": "object"}')
    for topic, columns in topics.items():
        channel = file.register_channel(topic=topic, message_encoding=encoding, schema_id=schema)
        for row in zip(*columns.values(), strict=True):
            message = {name: value for name, value in zip(columns, row, strict=True) if value == value}
            stamp = 1_700_000_000_000_000_000 + round(1e9 * message.pop("time"))
            nested = (
                {"drive": message, "state": "on", "pair": [message["angle"], 0.5]} if "angle" in message else message
            )
            data = json.dumps(nested).encode()
            file.add_message(channel_id=channel, log_time=stamp, publish_time=stamp, data=data)
    for topic in other:
        channel = file.register_channel(topic=topic, message_encoding="cdr", schema_id=schema)
        file.add_message(channel_id=channel, log_time=0, publish_time=0, data=b"\0\1\0\0")
    file.finish()
    path.write_bytes(content.getvalue())
    return path


def scope(groups, *, separator="\t", decimal=",", units=None, scales=None, dated=False, padded=False, eof=True):
    """A TwinCAT Scope export: key and value lines, an empty line, then rows in which the slow groups end first.

    groups: columns, each with its "time" [s]; units and scales: of channels by name.
    """

    def number(value):
        return f"{value:.9g}".replace(".", decimal)

    def line(key, cell):
        return separator.join(separator.join([key, *(cell(n) for n in g if n != "time")]) for g in groups)

    lines = [f"Name{separator}scope", f"File{separator}scope.tcscopex"]
    lines += [f"Starttime of export{separator}132959733843760000{separator}Montag, 2. Mai 2022{separator}15:56:24.376"]
    details = {"SymbolComment": "", "Data-Type": "REAL64", "SampleTime[ms]": "5", "Port": "851", "Offset": "0"}
    lines += ["", "", line("Name", str), *(line(key, lambda _, v=value: v) for key, value in details.items())]
    lines += [line("ScaleFactor", lambda name: (scales or {}).get(name, "1"))]
    lines += [line("Unit", lambda name: (units or {}).get(name, "(None)")), ""]
    columns = []
    for group in groups:
        for name, values in group.items():
            if name != "time":
                columns.append([number(v) for v in values])
            elif dated:
                columns.append([str(132959733843760000 + round(1e7 * t)) for t in values])
            else:
                columns.append([number(1e3 * t) for t in values])
    longest = max(map(len, columns))
    if padded:  # the scope repeats the rows of a slow group
        columns = [[c[k * len(c) // longest] for k in range(longest)] for c in columns]
    for k in range(longest):
        lines.append(separator.join(c[k] if k < len(c) else " " for c in columns).rstrip(f" {separator}"))
    return "\n".join([*lines, *["EOF"] * eof]) + "\n"
