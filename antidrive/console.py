"""Output of a command: progress on a terminal, text or JSON at the end."""

from __future__ import annotations

import shutil
import sys
import textwrap
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from antidrive.output import to_json

if TYPE_CHECKING:
    from antidrive.remaining_time import Watch

_BETWEEN = 10.0  # seconds between two lines of progress where there is no terminal


@dataclass(frozen=True, kw_only=True)
class Console:
    """Output of one command.

    Attributes:
        quiet: print nothing but errors (and JSON with `json`).
        json: print the result as JSON and nothing else on stdout.
        words: the command as typed.
    """

    quiet: bool = False
    json: bool = False
    words: tuple[str, ...] = ("antidrive",)

    def result(self, text: str, content: Any) -> None:
        """Print a result, as text or as JSON."""
        if self.json:
            print(to_json(content, ascii=not (sys.stdout.encoding or "utf-8").lower().startswith("utf")))
        elif not self.quiet and sys.stdout.isatty():
            _shown(text)
        elif not self.quiet:
            print(text)

    @contextmanager
    def progress(self, begin: str) -> Iterator[Callable[[str], None] | None]:
        """A function that shows a line of progress, and the time left, while the block runs; None if quiet.

        A terminal shows it continuously; otherwise, as in the log of a service, stderr gets a line every ten seconds.
        """
        if self.quiet:
            yield None
            return
        from antidrive.remaining_time import Watch

        watch = Watch(begin)
        with _on_a_terminal(watch) if sys.stderr.isatty() else _now_and_then(watch):
            yield watch.tell


def _on_a_terminal(watch: Watch) -> AbstractContextManager[object]:
    from rich.console import Console

    return Console(stderr=True).status(watch)


@contextmanager
def _now_and_then(watch: Watch) -> Iterator[None]:
    ended, stream = threading.Event(), sys.stderr

    def report() -> None:
        while not ended.wait(_BETWEEN):
            print(f"antidrive: {watch}", file=stream, flush=True)

    reporter = threading.Thread(target=report, daemon=True)
    reporter.start()
    try:
        yield
    finally:
        ended.set()
        reporter.join()


def print_error(sentence: str) -> None:
    """Print an error on stderr: a sentence in one line, or on a terminal without breaking words.

    Lines below it, such as a table, are printed unchanged.
    """
    sentence, *lines = sentence.splitlines()
    sentence = f"antidrive: {' '.join(sentence.split())}"
    if sys.stderr.isatty():
        width = shutil.get_terminal_size().columns
        sentence = textwrap.fill(sentence, width, break_long_words=False, break_on_hyphens=False)
    print("\n".join([sentence, *lines]), file=sys.stderr)


def _shown(text: str) -> None:
    """Print lines on a terminal: the first is bold, warnings are coloured, and wrapped lines keep their indentation.

    There is no colour if NO_COLOR is set.
    """
    from rich.console import Console
    from rich.padding import Padding
    from rich.text import Text

    console = Console(highlight=False)
    for number, line in enumerate(text.splitlines()):
        words = line.lstrip()
        style = "bold" if number == 0 else "yellow" if words.startswith("warning:") else ""
        console.print(Padding(Text(words, style=style), (0, 0, 0, len(line) - len(words))))
