"""Ctrl-C and SIGTERM: the command is unwound as by an error, so that no files are left behind, and then ends at once.

Threads may still be in machine code for a while; they are not waited for.
"""

from __future__ import annotations

import _thread
import atexit
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_AGAIN = 0.05  # delay until a signal that was ignored is raised again [s]


class Stopped(BaseException):
    """The command was interrupted; the exit code is that of a shell for the signal."""

    def __init__(self, number: int = signal.SIGINT) -> None:
        """By a signal of that number."""
        super().__init__(number)
        self.code = 128 + number


@contextmanager
def stoppable() -> Iterator[None]:
    """Within the block a signal raises `Stopped`, once: the clean-up is not interrupted again.

    Python ignores exceptions while an object is finalised, or a module's lock; then the signal is raised again a little
    later. A library that is interrupted may raise another error; that becomes `Stopped` too.
    """
    reported = sys.unraisablehook
    come: list[int] = []

    def stop(number: int, frame: Any) -> NoReturn:
        for each in _SIGNALS:
            signal.signal(each, signal.SIG_IGN)
        come.append(number)
        raise Stopped(number)

    def ignored(raised: Any) -> None:
        if not isinstance(raised.exc_value, Stopped):
            reported(raised)
            return
        for each in _SIGNALS:
            signal.signal(each, stop)
        threading.Timer(_AGAIN, _thread.interrupt_main, (raised.exc_value.code - 128,)).start()

    with _handled(stop):
        sys.unraisablehook = ignored
        try:
            yield
        except Exception as error:
            if come:
                raise Stopped(come[0]) from error
            raise
        finally:
            sys.unraisablehook = reported


@contextmanager
def unstoppable() -> Iterator[None]:
    """Within the block a signal is delayed until its end."""
    come: list[int] = []
    with _handled(lambda number, frame: come.append(number)):
        yield
    for number in come[:1]:
        signal.raise_signal(number)


@contextmanager
def _handled(handler: Any) -> Iterator[None]:
    """Signals go to that handler, in the main thread; other threads never get any."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)


def leave(code: int) -> NoReturn:
    """End the process without waiting for its threads; running compilers are ended and their folders removed."""
    if "plant.machine_code" in sys.modules:  # else nothing was started, and the import takes a while
        from plant.machine_code import start_no_more

        start_no_more()
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(code)
