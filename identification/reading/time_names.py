"""What people call the time of a table, and the unit that such a name may carry."""

from __future__ import annotations

import re

_TIME = re.compile(
    r"%?(rel(ative)?[ _]?|elapsed[ _]?|x[ _])?(time|t|time[ _]?stamps?|stamps?|zeit|zeitstempel|clock)"
    r"\s*[_\[(]?\s*(?P<unit>(s|sec|secs|seconds?|ms|us|µs|μs|ns|min)?)\s*[\])]?",
    re.IGNORECASE,
)


def is_time(name: str) -> bool:
    """Whether a column is called as times are: `time`, `t`, `Time (s)`, `timestamp`, `time_ms`, `Zeit [ms]`."""
    return bool(_TIME.fullmatch(name.strip()))


def time_unit(name: str) -> str:
    """The unit in the name of a time, "" where it has none."""
    found = _TIME.fullmatch(name.strip())
    return found["unit"].lower() if found else ""
