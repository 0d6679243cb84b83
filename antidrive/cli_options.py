"""Command-line options shared by many commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Out = Annotated[Path, typer.Option(metavar="FOLDER", help="Folder for the results.")]
Seed = Annotated[int, typer.Option(min=0, metavar="N", help="Seed of the random numbers.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print errors only.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON only.")]
Force = Annotated[bool, typer.Option("--force", help="Use the log in spite of its faults.")]
OUT = Path("antidrive-out")
