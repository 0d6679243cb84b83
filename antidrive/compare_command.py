"""`antidrive compare`: changes since a model was identified."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from antidrive.cli_fit_options import Candidates, Effects, Exclude, Fixed, fit_options
from antidrive.cli_log_options import with_log
from antidrive.cli_options import OUT, Force, Json, Out, Quiet


@with_log
def compare(
    context: typer.Context,
    model: Annotated[Path, typer.Argument(metavar="MODEL.json", help="Model that was identified before.")],
    log: Any,
    fixed: Fixed = None,
    candidates: Candidates = None,
    exclude: Exclude = None,
    effects: Effects = None,
    force: Force = False,
    out: Out = OUT,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Show which parameters have changed since a model was identified. Writes comparison.json, .csv, report.html."""
    from antidrive.comparison_page import changes_page
    from antidrive.console import Console
    from antidrive.model_comparison import compare as compared
    from antidrive.output import whole_folder, write_json, written
    from antidrive.own_effects import read_identified
    from antidrive.provenance import Provenance

    console = Console(quiet=quiet, json=json, words=context.obj)
    known = log.fit.merged(fit_options(fixed=fixed, candidates=candidates, exclude=exclude, effects=effects))
    before = read_identified(model, known.effects)
    with whole_folder(out) as draft:
        with console.progress("reading") as progress:
            measured = log.read(progress)
        with console.progress("comparing") as progress:
            found = compared(
                before,
                measured.log,
                holdout=measured.holdout,
                fixed=known.fixed,
                candidates=known.choice(known.own_effects()),
                exclude=known.exclude,
                force=force,
                progress=progress,
            )
        found.diagnosis.extended.model_file().write(draft / "model.json")
        write_json(draft / "comparison.json", found.to_dict())
        found.to_frame().to_csv(draft / "comparison.csv")
        page = changes_page(found, Provenance.now(console.words, measured.log.sources))
        (draft / "report.html").write_text(page, encoding="utf-8")
    warned = [f"  warning: {text}" for text in measured.log.warnings]
    files = "comparison.json, comparison.csv, model.json, report.html"
    console.result("\n".join([*found.sentences(), *warned, written(out, files)]), found.to_dict())
