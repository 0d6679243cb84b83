"""How long a task still takes, where that is known: where its parts are counted, and the pace so far is the pace.

The remaining time of a fit or a diagnosis cannot be estimated well: each effect that is found adds fits. So only the
elapsed time is shown, and what is being done.
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

_WORTH_TELLING = 2.0  # seconds that one waits without asking, and from which parts have a pace


Tell: TypeAlias = Callable[[str], None]


@dataclass
class Parts:
    """Counts the parts of a task that are done, and tells each hundredth."""

    of: float
    tell: Tell | None = None
    doing: str = "simulating"
    finished: float = 0.0

    def done(self, parts: float = 1.0) -> None:
        """So many parts more are done."""
        before, self.finished = self.finished, self.finished + parts
        if self.tell is not None and int(100 * self.finished / self.of) > int(100 * before / self.of):
            self.tell(f"{self.doing}, {int(100 * self.finished / self.of)} of 100 parts are done")


@dataclass(frozen=True)
class _Count:
    """So many parts of all are done at an instant [s]."""

    at: float
    done: int
    of: int


@dataclass
class Watch:
    """The line of a task that runs, with the time that has passed and, once it can be told, the time left."""

    line: str
    clock: Callable[[], float] = time.monotonic
    begun: float = field(init=False)
    first: _Count | None = field(init=False, default=None)
    last: _Count | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        """Begin."""
        self.begun = self.clock()

    @property
    def passed(self) -> float:
        """Since the beginning [s]."""
        return self.clock() - self.begun

    def tell(self, line: str) -> None:
        """Go on to that line; "3 of 25" in it says how far the task is."""
        self.line = line
        parts = re.search(r"\b(\d+) of (\d+)\b", line)
        count = None if parts is None else _Count(self.passed, int(parts[1]), int(parts[2]))
        if self.first is None or count is None or count.of != self.first.of or count.done < self.first.done:
            self.first = count  # what went before was something else, and does not show the pace
        self.last = count

    @property
    def left(self) -> float | None:
        """Time left at the pace of the parts that were counted [s]; None where there is no pace, or it did not last."""
        if self.first is None or self.last is None:
            return None
        took, parts = self.last.at - self.first.at, self.last.done - self.first.done
        if parts == 0 or took < _WORTH_TELLING:
            return None
        left = took * (self.last.of - self.last.done) / parts - (self.passed - self.last.at)
        return left if left > 0.0 else None

    @property
    def times(self) -> str:
        """The time that has passed, and the time left as far as it is known; nothing where nobody has waited yet."""
        passed, left = self.passed, self.left
        if passed < _WORTH_TELLING:
            return ""
        return f" ({passed:.0f} s)" if left is None else f" ({passed:.0f} s, about {max(left, 1.0):.0f} s left)"

    def __str__(self) -> str:
        """The line, and the times."""
        return self.line + self.times

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Text]:
        """The same in one line of a terminal: the times are never cut off."""
        from rich.text import Text

        times = self.times
        yield Text(textwrap.shorten(self.line, max(options.max_width - len(times), 10), placeholder=" ...") + times)
