"""How long a task still takes: from the time that has passed, and the course that such tasks usually run."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

_DIAGNOSIS = (
    ("round 1: asking", 0.15),
    ("round 1: refitting", 0.2),
    ("round 2: asking", 0.6),
    ("round 2: refitting", 0.65),
    ("looking for what has no name", 0.86),
    ("measuring the gain", 0.95),
)
COURSES: Mapping[str, tuple[tuple[str, float], ...]] = {
    "fitting": tuple(("observer", share) for share in (0.3, 0.4, 0.5, 0.6)),
    "diagnosing": _DIAGNOSIS,
    "recording": (*((line, 0.15 + 0.8 * share) for line, share in _DIAGNOSIS), ("closing the loop", 0.96)),
}
"""By how a task's first line begins: lines of its later stages, and the share of its time in which it comes to them.

Shares are of a log in which one effect is missing. Each effect more takes a round more, and the time left grows.
"""
_WORTH_TELLING = 2.0  # seconds that one waits without asking


Tell: TypeAlias = Callable[[str], None]


@dataclass
class Parts:
    """Counts the parts of a task that are done, and tells each hundredth."""

    of: float
    tell: Tell | None = None
    finished: float = 0.0

    def done(self, parts: float = 1.0) -> None:
        """So many parts more are done."""
        before, self.finished = self.finished, self.finished + parts
        if self.tell is not None and int(100 * self.finished / self.of) > int(100 * before / self.of):
            self.tell(f"simulating, {int(100 * self.finished / self.of)} of 100 parts are done")


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

    def __str__(self) -> str:
        """The line, and the times where somebody waits."""
        passed = self.passed
        if passed < _WORTH_TELLING:
            return self.line
        left = (
            "" if self.whole is None or passed > self.whole else f", about {max(self.whole - passed, 1.0):.0f} s left"
        )
        return f"{self.line} ({passed:.0f} s{left})"

    def __rich__(self) -> str:
        """The same, with nothing taken for markup."""
        from rich.markup import escape

        return escape(str(self))
