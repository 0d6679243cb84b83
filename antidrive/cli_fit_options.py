"""Command-line options for prior knowledge of parameters and effects; read by `fit_options`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from antidrive import completion

PANEL = "What is known beforehand"

Fixed = Annotated[
    list[str] | None,
    typer.Option(
        "--fixed",
        rich_help_panel=PANEL,
        metavar="NAME[=VALUE]",
        help="Parameter to keep at its value. May be repeated.",
    ),
]
Bounds = Annotated[
    list[str] | None,
    typer.Option(
        "--bounds", rich_help_panel=PANEL, metavar="NAME=LOW:HIGH", help="Bounds of a parameter: inertia=0.1:0.3."
    ),
]
Prior = Annotated[
    list[str] | None,
    typer.Option(
        "--prior",
        rich_help_panel=PANEL,
        metavar="NAME=MEAN:STD",
        help="Gaussian prior of a parameter: inertia=0.2:0.05.",
    ),
]
PerRun = Annotated[
    list[str] | None,
    typer.Option(
        "--per-run",
        rich_help_panel=PANEL,
        metavar="NAME",
        help="Parameter that is fitted for each run separately: inertia.",
    ),
]
Exclude = Annotated[
    list[str] | None,
    typer.Option(
        "--exclude",
        rich_help_panel=PANEL,
        metavar="EFFECT",
        help="Effect that is not tried. May be repeated.",
        autocompletion=completion.effects,
    ),
]
Candidates = Annotated[
    list[str] | None,
    typer.Option(
        "--candidates",
        rich_help_panel=PANEL,
        metavar="EFFECT",
        help="Try these effects only. May be repeated.",
        autocompletion=completion.effects,
    ),
]
Effects = Annotated[
    Path | None,
    typer.Option("--effects", rich_help_panel=PANEL, metavar="FILE.py", help="Python file with effects of your own."),
]
Inverse = Annotated[
    bool | None,
    typer.Option(
        "--inverse/--no-inverse",
        rich_help_panel=PANEL,
        help="Fit an inverse model, which predicts the torque from the motion: for a robot joint in a tight loop. "
        "By default only if a model of the motion explains none of the torque.",
    ),
]


def fit_options(**words: Any) -> Any:
    """The `FitOptions` of these words; imported only here, as the plant is slow to import."""
    from antidrive.fit_options import FitOptions

    return FitOptions.typed(**words)
