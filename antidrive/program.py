"""A command from its first word to the exit code, and what is said where it ends before its time."""

from __future__ import annotations

import io
import shlex
import sys
import traceback
from contextvars import Context
from typing import Any

import typer

from antidrive.interruption import Stopped, leave, stoppable

UsageError: Any = typer.BadParameter.__bases__[0]  # every mistake in the words of a command line
_SIGNALLED = 128  # exit codes above it say by which signal


def run(app: typer.Typer, words: list[str], *, whole: bool) -> int:
    """Run the command of these words and return the exit code.

    Args:
        app: all commands.
        words: what was typed.
        whole: whether the command is all that the process does, which then ends where it is stopped.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="replace")  # what a console cannot show
    code = Context().run(_command, app, words)  # what it remembers ends with it
    if whole and code > _SIGNALLED:
        leave(code)
    return code


def _command(app: typer.Typer, words: list[str]) -> int:
    try:
        with stoppable():
            code = int(app(words, prog_name="antidrive", standalone_mode=False, obj=("antidrive", *words)) or 0)
            if code > _SIGNALLED:  # typer's answer to KeyboardInterrupt
                raise Stopped(code - _SIGNALLED)
    except (Stopped, KeyboardInterrupt, typer.Abort) as stopped:
        from antidrive.output import left

        print(f"antidrive: stopped; {left()}.", file=sys.stderr)
        return (stopped if isinstance(stopped, Stopped) else Stopped()).code
    except Exception as error:
        return _failed(error, words)
    return code


def _usage(error: Any) -> str:
    """A mistake in the words of a command line, and where to look them up."""
    path = "antidrive" if error.ctx is None else error.ctx.command_path
    message = error.format_message()
    return f"{message}{'' if message.endswith(('.', '?')) else '.'} See `{path} --help`."


def _failed(error: Exception, words: list[str]) -> int:
    """Say what went wrong on stderr, and return the exit code."""
    from antidrive.console import print_error
    from antidrive.output import left
    from identification.errors import MissingColumns
    from plant.errors import AntidriveError

    if isinstance(error, MissingColumns):
        print_error(error.with_command(shlex.join(("antidrive", *words))))
        return 2
    if isinstance(error, AntidriveError | UsageError):
        print_error(_usage(error) if isinstance(error, UsageError) else str(error))
        return 2
    traceback.print_exception(error)
    print_error(f"this is a fault of the program and not of the input; {left()}.")
    return 1
