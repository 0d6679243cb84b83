"""`antidrive friction`: a quick friction test from a staircase of speeds or slow sweeps."""

from __future__ import annotations

from typing import Any

import typer

from antidrive.cli_log_options import with_log
from antidrive.cli_options import OUT, Force, Json, Out, Quiet

_NO_MODEL = "No model.json: {why}. friction.csv is the table."
_NO_INERTIA = "this log does not show the inertia, as a slow sweep or a chirp does"


@with_log
def friction(
    context: typer.Context, log: Any, force: Force = False, out: Out = OUT, quiet: Quiet = False, json: Json = False
) -> None:
    """Measure friction over speed from a staircase or slow sweeps. Writes friction.csv, model.json, report.html."""
    from antidrive.console import Console
    from antidrive.friction_page import friction_page
    from antidrive.output import whole_folder, write_json, written
    from antidrive.provenance import Provenance
    from antidrive.table_files import csv_text
    from identification.friction_test import friction_test
    from plant.model_file import ModelFile

    console = Console(quiet=quiet, json=json, words=context.obj)
    stale = (out / "model.json").is_file()
    with whole_folder(out, replaced=("model.json",)) as draft:
        with console.progress("reading") as progress:
            measured = log.read(progress)
        found = friction_test(measured.log.usable(force=force))
        content, model = found.to_dict(), found.model
        units = {
            "velocity": found.units["speed"],
            **dict.fromkeys(("torque", "error", "curve"), found.log.command_unit),
        }
        (draft / "friction.csv").write_text(csv_text(dict(found.to_frame()), units), encoding="utf-8")
        write_json(draft / "friction.json", content)
        files = ["friction.csv", "friction.json", "report.html"]
        if model is not None:
            source = tuple({"file": s.file, "sha256": s.sha256} for s in found.log.sources)
            ModelFile(model=model, std=found.model_std(), source=source).write(draft / "model.json")
            files.insert(2, "model.json")
        page = friction_page(found, Provenance.now(console.words, found.log.sources))
        (draft / "report.html").write_text(page, encoding="utf-8")
    notes = []
    if model is None:
        notes = [_NO_MODEL.format(why="the friction is negative" if found.negative else _NO_INERTIA)]
        notes += [f"The model.json of an earlier run was removed from {out}."] if stale else []
    warned = [f"  warning: {text}" for text in found.log.warnings]
    console.result("\n".join([*found.sentences(), *notes, *warned, written(out, ", ".join(files))]), content)
