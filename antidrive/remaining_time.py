"""Remaining time of a task, if its parts are counted, extrapolated from the pace so far.

The remaining time of a fit or a diagnosis cannot be estimated well, as each effect that is found adds fits. Then only
the elapsed time and the present step are shown.
"""

from __future__ import annotations

import re
import textwrap
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions
    from rich.text import Text

_LEAST_ELAPSED = 2.0  # least elapsed time [s] to be shown, and to estimate a pace from


Tell: TypeAlias = Callable[[str], None]


@dataclass
class Parts:
    """Counts the finished parts of a task, and reports each hundredth."""

    of: float
    tell: Tell | None = None
    doing: str = "simulating"
    finished: float = 0.0

    def done(self, parts: float = 1.0) -> None:
        """Add finished parts."""
        before, self.finished = self.finished, self.finished + parts
        if self.tell is not None and int(100 * self.finished / self.of) > int(100 * before / self.of):
            self.tell(f"{self.doing}, {int(100 * self.finished / self.of)} of 100 parts are done")


@dataclass(frozen=True)
class _Count:
    """Number of finished parts, of all, at an instant [s]."""

    at: float
    done: int
    of: int


@dataclass
class Watch:
    """The progress line of a running task, with the elapsed time and, if it can be estimated, the remaining time."""

    line: str
    clock: Callable[[], float] = time.monotonic
    begun: float = field(init=False)
    first: _Count | None = field(init=False, default=None)
    last: _Count | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        """Start the clock."""
        self.begun = self.clock()

    @property
    def passed(self) -> float:
        """Elapsed time [s]."""
        return self.clock() - self.begun

    def tell(self, line: str) -> None:
        """Set the line; "3 of 25" in it is the number of finished parts."""
        self.line = line
        parts = re.search(r"\b(\d+) of (\d+)\b", line)
        count = None if parts is None else _Count(self.passed, int(parts[1]), int(parts[2]))
        if self.first is None or count is None or count.of != self.first.of or count.done < self.first.done:
            self.first = count  # earlier parts belong to another task and do not show the pace
        self.last = count

    @property
    def left(self) -> float | None:
        """Remaining time at the pace of the counted parts [s]; None without a pace, or if it has run out."""
        if self.first is None or self.last is None:
            return None
        took, parts = self.last.at - self.first.at, self.last.done - self.first.done
        if parts == 0 or took < _LEAST_ELAPSED:
            return None
        left = took * (self.last.of - self.last.done) / parts - (self.passed - self.last.at)
        return left if left > 0.0 else None

    @property
    def times(self) -> str:
        """The elapsed time, and the remaining time if it is known; empty during the first seconds."""
        passed, left = self.passed, self.left
        if passed < _LEAST_ELAPSED:
            return ""
        return f" ({passed:.0f} s)" if left is None else f" ({passed:.0f} s, about {max(left, 1.0):.0f} s left)"

    def __str__(self) -> str:
        """The line, and the times."""
        return self.line + self.times

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Text]:
        """The same in one line of a terminal; the times are never cut off."""
        from rich.text import Text

        times = self.times
        yield Text(textwrap.shorten(self.line, max(options.max_width - len(times), 10), placeholder=" ...") + times)
