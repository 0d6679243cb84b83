"""Raw recordings of a CAN bus: a measured value is some bits of a frame, named in the bus description only."""

from __future__ import annotations

import re
from collections.abc import Sequence

from identification.errors import MalformedLog

_FRAMES = (
    re.compile(r"\s*\(\d+\.\d+\)\s+\w+\s+[0-9A-Fa-f]{1,8}(##?[0-9A-Fa-fRr]*|\s+\[\d+\])"),  # candump -l, -ta
    re.compile(r"\s*\w*can\d+\s+[0-9A-Fa-f]{3,8}\s+\[\d+\]"),  # candump on a terminal
    re.compile(r"\s*\d+\.\d+\s+\d+\s+[0-9A-Fa-f]+x?\s+[RT]x\s+d\s+\d"),  # .asc of Vector
    re.compile(r";\$FILEVERSION="),  # .trc of PEAK
)
_SEARCHED = 20  # lines


def refuse_bus(lines: Sequence[str], name: str) -> None:
    """Raise `MalformedLog` if lines of a text are frames of a bus."""
    if any(frame.match(line) for line in lines[:_SEARCHED] for frame in _FRAMES):
        raise MalformedLog(
            f"{name}: this is a raw recording of a CAN bus; decode it with the .dbc of the bus and export its signals "
            "as a table, as cantools, asammdf or SavvyCAN do."
        )
