"""What a command says: progress on a terminal, words or JSON at the end."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from antidrive.output import to_json


@dataclass(frozen=True, kw_only=True)
class Voice:
    """How one command speaks.

    Attributes:
        quiet: print nothing but errors (and JSON, when asked for).
        json: print the result as JSON and nothing else on stdout.
        words: the command as typed.
    """

    quiet: bool = False
    json: bool = False
    words: tuple[str, ...] = ("antidrive",)

    def result(self, text: str, content: Any) -> None:
        """Print a result, in words or as JSON."""
        if self.json:
            print(to_json(content))
        elif not self.quiet:
            print(text)

    @contextmanager
    def progress(self, begin: str) -> Iterator[Callable[[str], None] | None]:
        """A function that shows a line of progress while the block runs; None where nobody watches."""
        if self.quiet or not sys.stderr.isatty():
            yield None
            return
        from rich.console import Console
        from rich.markup import escape

        with Console(stderr=True).status(escape(begin)) as status:
            yield lambda line: status.update(escape(line))
