"""`antidrive table`: tables and numbers for the compensation in a drive."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from antidrive import completion
from antidrive.cli_fit_options import Effects
from antidrive.cli_options import OUT, Json, Out, Quiet


def table(
    context: typer.Context,
    kind: Annotated[
        str,
        typer.Argument(
            metavar="KIND",
            autocompletion=completion.tables,
            help=f"{', '.join(completion.TABLES[:-1])} or {completion.TABLES[-1]}.",
        ),
    ],
    model: Annotated[Path, typer.Argument(metavar="MODEL.json", help="Model whose effects are tabulated.")],
    points: Annotated[int | None, typer.Option(metavar="N", help="Rows of the table. Default: 64.")] = None,
    reach: Annotated[
        str | None,
        typer.Option("--range", metavar="LOW:HIGH", help="First and last velocity, angle or torque, in SI units."),
    ] = None,
    single: Annotated[bool, typer.Option("--single", help="C arrays in single precision.")] = False,
    effects: Effects = None,
    out: Out = OUT,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write a compensation table for a drive: friction, cogging, position error. Writes CSV and C arrays."""
    from antidrive.console import Console
    from antidrive.output import whole_folder, written
    from antidrive.own_effects import read_identified
    from antidrive.table_files import NUMBERS, c_numbers, c_table, csv_text, numbers_of, summary_line
    from plant.drive_table import drive_table
    from plant.errors import BadParameter

    console, read = Console(quiet=quiet, json=json, words=context.obj), read_identified(model, effects)
    if kind not in completion.TABLES:
        raise BadParameter(f"There is no table {kind!r}; there are {', '.join(completion.TABLES)}.")
    if kind in NUMBERS:
        if points is not None or reach is not None:
            raise BadParameter(f"{kind} is no table but a few numbers; leave --points and --range out.")
        numbers = numbers_of(read, kind)
        if not numbers:
            own = ", ".join(effect.title for effect in read.model.effects) or "none"
            raise BadParameter(f"The model has no {kind.replace('-', ' ')}; its effects: {own}.")
        columns = {field: [getattr(number, field) for number in numbers] for field in ("name", "value", "std", "unit")}
        csv, header = csv_text(columns, {}), c_numbers(kind, numbers, single=single)
        lines = [str(number) for number in numbers]
        content = {"schema": 1, "kind": kind, "numbers": [vars(number) for number in numbers]}
    else:
        made = drive_table(read.model, kind, points=64 if points is None else points, reach=_range(reach))
        csv, header = csv_text(made.columns, made.units), c_table(made, single=single)
        first, last = made.ends
        from_to = f"{made.columns[first][0]:.4g} to {made.columns[first][-1]:.4g} {made.units[first]}"
        lines = [f"{made.points} points of the {first} from {from_to}. {last}: {made.meaning}.", *summary_line(made)]
        content = {"schema": 1, "kind": kind, "columns": made.columns, "units": made.units, "notes": made.notes}
        content |= {"harmonics": made.harmonics, "largest_error": made.largest_error}
    files = {f"{kind}.csv": csv, f"antidrive_{kind.replace('-', '_')}.h": header}
    with whole_folder(out) as draft:
        for name, text in files.items():
            (draft / name).write_text(text, encoding="utf-8")
    console.result("\n".join([*lines, written(out, ", ".join(files))]), {**content, "files": list(files)})


def _range(typed: str | None) -> tuple[float, float] | None:
    from plant.errors import BadParameter

    if typed is None:
        return None
    try:
        low, high = map(float, typed.split(":"))
    except ValueError:
        raise BadParameter(f"--range {typed!r}: write it as LOW:HIGH, for example --range -5:5.") from None
    return low, high
