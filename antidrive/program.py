"""Run of a command up to its exit code, with the error message if it fails or is interrupted."""

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
_SIGNALLED = 128  # higher exit codes encode the signal


def run(app: typer.Typer, words: list[str], *, whole: bool) -> int:
    """Run the command of these words and return the exit code.

    Args:
        app: all commands.
        words: the words of the command line.
        whole: whether the process only runs this command; it then ends when the command is interrupted.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="replace")  # characters that the console cannot show
    code = Context().run(_command, app, words)  # context variables of the command end with it
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
    """Message on a mistake in the words of a command line, with a pointer to the help."""
    path = "antidrive" if error.ctx is None else error.ctx.command_path
    message = error.format_message()
    return f"{message}{'' if message.endswith(('.', '?')) else '.'} See `{path} --help`."


def _failed(error: Exception, words: list[str]) -> int:
    """Print the error on stderr, and return the exit code."""
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
