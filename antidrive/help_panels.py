"""Groups of commands and options in `--help`: commands in the order in which a user needs them."""

from __future__ import annotations

from typing import Any, get_args

import typer

COMMANDS: dict[str, tuple[str, ...]] = {
    "Begin": ("demo", "plan", "inspect"),
    "Identify a machine": ("identify", "diagnose", "compare", "friction", "effects"),
    "Use the model": ("predict", "table", "export"),
    "Two preloaded drives": ("simulate", "allocate", "capability"),
}
"""All commands by their group."""

FIRST = (
    "Examples:",
    "  antidrive demo",
    "  antidrive inspect log.csv",
    "  antidrive diagnose antidrive-out/log.toml",
    "Exit code 0: done; 2: bad input, reported in one sentence; 130 or 143: stopped; 1: anything else. "
    "More on a command: antidrive COMMAND --help.",
)
"""Text below the commands, by paragraph."""


def grouped(app: typer.Typer) -> None:
    """Show the commands of a program in these groups and this order."""
    titles = {name: title for title, names in COMMANDS.items() for name in names}
    for command in app.registered_commands:
        command.rich_help_panel = titles[_name(command)]
    app.registered_commands.sort(key=lambda command: list(titles).index(_name(command)))


def _name(command: Any) -> str:
    return str(command.name or command.callback.__name__)


def in_panel(title: str, options: dict[str, Any]) -> dict[str, Any]:
    """Put options into a separate group of `--help`."""
    for kind in options.values():
        for option in get_args(kind)[1:]:
            if isinstance(option, typer.models.OptionInfo):
                option.rich_help_panel = title
    return options
