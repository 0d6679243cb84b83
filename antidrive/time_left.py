"""How long a task still takes: from the time that has passed, and the course that such tasks usually run."""

from __future__ import annotations

import re
import textwrap
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions
    from rich.text import Text

_ROUNDS = 6  # of a diagnosis, at most
_DIAGNOSIS = (
    *(("observer", share) for share in (0.02, 0.025, 0.03, 0.035)),
    ("round 1: asking", 0.06),
    ("round 1: refitting", 0.08),
    *(
        (f"round {number}: {doing}", share + 0.1 * number)
        for number in range(2, _ROUNDS + 1)
        for doing, share in (("asking", 0.02), ("refitting", 0.05))
    ),
    ("is it still", 0.65),
    ("looking for what has no name", 0.75),
    ("or is it not", 0.78),
    ("measuring the gain", 0.95),
)
COURSES: Mapping[str, tuple[tuple[str, float], ...]] = {
    "fitting": tuple(("observer", share) for share in (0.3, 0.4, 0.5, 0.6)),
    "diagnosing": _DIAGNOSIS,
    "recording": (*((line, 0.15 + 0.8 * share) for line, share in _DIAGNOSIS), ("closing the loop", 0.96)),
}
"""By how a task's first line begins: lines of its later stages, and the share of its time in which it comes to them.

How many effects are missing a diagnosis does not know before its end. Each takes a round more; the shares of rounds are
middling ones, of logs in which none to three are missing.
"""
_WORTH_TELLING = 2.0  # seconds that one waits without asking
_OVERDUE = 0.1  # of the time that has passed, which is left at least: what was overdue will not end at once


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


@dataclass
class Watch:
    """The line of a task that runs, with the time that has passed and, once it can be told, the time left."""

    line: str
    clock: Callable[[], float] = time.monotonic
    begun: float = field(init=False)
    whole: float | None = field(init=False, default=None)
    ahead: list[tuple[str, float]] = field(init=False)

    def __post_init__(self) -> None:
        """Begin."""
        self.begun = self.clock()
        self.ahead = list(COURSES.get(self.line.split()[0], ()))

    @property
    def passed(self) -> float:
        """Since the beginning [s]."""
        return self.clock() - self.begun

    def tell(self, line: str) -> None:
        """Go on to the stage of that line; "3 of 25" in it says how far the task is."""
        self.line = line
        parts = re.search(r"\b(\d+) of (\d+)\b", line)
        stage = next((place for place, (begins, _) in enumerate(self.ahead) if line.startswith(begins)), None)
        if parts and int(parts[1]):
            self.whole = self.passed * int(parts[2]) / int(parts[1])
        elif stage is not None:
            self.whole = self.passed / self.ahead[stage][1]
            del self.ahead[: stage + 1]

    @property
    def times(self) -> str:
        """The time that has passed, and the time left as far as it is known; nothing where nobody has waited yet."""
        passed = self.passed
        if passed < _WORTH_TELLING:
            return ""
        if self.whole is None:
            return f" ({passed:.0f} s)"
        return f" ({passed:.0f} s, about {max(self.whole - passed, _OVERDUE * passed, 1.0):.0f} s left)"

    def __str__(self) -> str:
        """The line, and the times."""
        return self.line + self.times

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Text]:
        """The same in one line of a terminal: the times are never cut off."""
        from rich.text import Text

        times = self.times
        yield Text(textwrap.shorten(self.line, max(options.max_width - len(times), 10), placeholder=" ...") + times)
