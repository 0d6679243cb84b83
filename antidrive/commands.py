"""The work of each command, from options to files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from antidrive import report
from antidrive.console import Console
from antidrive.fit_options import FitOptions
from antidrive.log_options import LogOptions, Measured
from antidrive.output import PAGES, whole_file, whole_folder, write_json, written
from antidrive.own_effects import read_own_model
from antidrive.provenance import Provenance
from antidrive.remaining_time import Tell
from diagnosis.explanation.summary import headline, sentences
from identification.errors import Unidentifiable
from identification.log import Log
from plant.errors import BadParameter
from plant.model_file import ModelFile, read_model
from plant.servo import ServoModel
from plant.suggestion import suggestion

if TYPE_CHECKING:
    from antidrive.scenario_file import Design
    from diagnosis.diagnosis import Diagnosis
    from diagnosis.experiment import Experiment
    from plant.effects import Effect

__all__ = [
    "Console",
    "demo",
    "diagnose",
    "effects",
    "identify",
    "inspect",
    "predict",
    "simulate",
]

_EXPERIMENT = "separating_experiment.csv"


def identify(
    options: LogOptions, *, base: Path | None, known: FitOptions, force: bool, out: Path, seed: int, console: Console
) -> None:
    """Fit a model and write model.json, fit.json and report.html; of a fit without a result nothing, unless forced."""
    from diagnosis import identifiability_warnings, standstill, torque_follows, unexplained_torque
    from identification.fit import fit
    from identification.fit_result import fit_report, fit_to_dict
    from identification.simulation import free_simulation

    known = options.fit.merged(known)
    start = _base(base, known.own_effects())
    with whole_folder(out) as draft:
        measured = _read(options, console)
        with console.progress("fitting") as progress:
            found = fit(
                measured.log,
                start or measured.base,
                fixed={**dict.fromkeys(measured.absent(start)), **known.fixed},
                bounds=known.bounds,
                prior=known.prior,
                per_run=known.per_run,
                inverse=bool(measured.inverse if known.inverse is None else known.inverse),
                force=force,
                progress=progress,
            )
            why = standstill(found)
            if why is None and found.failed is not None:
                why = torque_follows(found.log) or f"The fit failed: {found.failed}"
            if why is not None and not force:
                raise Unidentifiable(why)
            recorded = found.log if found.log.response == "torque" else measured.log
            simulated = free_simulation(recorded, found.model)
        content = fit_to_dict(found)
        unidentifiable = (*identifiability_warnings(found), *filter(None, (unexplained_torque(found),)))
        content["data"]["warnings"] += unidentifiable
        provenance = Provenance.now(console.words, measured.log.sources)
        found.model_file(options.reading().gears).write(draft / "model.json")
        write_json(draft / "fit.json", content)
        page = report.fit_page(found, simulated, provenance, notes=measured.notes, warnings=unidentifiable)
        (draft / "report.html").write_text(page, encoding="utf-8")
    lines = [
        fit_report(found),
        *_data_lines(found.log, unidentifiable),
        written(out, "model.json, fit.json, report.html"),
    ]
    console.result("\n".join(lines), content)


def diagnose(
    options: LogOptions, *, base: Path | None, known: FitOptions, force: bool, out: Path, seed: int, console: Console
) -> None:
    """Find the effects that the model lacks and write diagnosis.json, model.json and report.html."""
    from diagnosis.diagnose import diagnose as find_causes

    known = options.fit.merged(known)
    if known.per_run:
        raise BadParameter(
            "per_run is for identify. In a diagnosis runs may differ by columns of the log alone, as payload_inertia."
        )
    own = known.own_effects()
    start = _base(base, own)
    with whole_folder(out) as draft:
        measured = _read(options, console)
        with console.progress("diagnosing") as progress:
            found = find_causes(
                measured.log,
                start or measured.base,
                measured.holdout,
                fixed={**dict.fromkeys(measured.absent(start)), **known.fixed},
                bounds=known.bounds,
                prior=known.prior,
                candidates=known.choice(own),
                exclude=known.exclude,
                inverse=measured.inverse if known.inverse is None else known.inverse,
                force=force,
                progress=progress,
            )
        held_out = measured.holdout.sources if measured.holdout is not None else ()
        provenance = Provenance.now(console.words, (*measured.log.sources, *held_out))
        found.extended.model_file(options.reading().gears).write(draft / "model.json")
        content, files, experiment, notes = found.to_dict(), "diagnosis.json, model.json", None, []
        if found.verdict == "ambiguous":
            with console.progress("designing an experiment that separates the competing effects") as progress:
                experiment, sentence = _separating(found, seed, progress)
            notes.append(sentence)
            if experiment is not None and experiment.separable:
                experiment.write(draft / _EXPERIMENT)
                content["separating_experiment"] = experiment.to_dict(file=_EXPERIMENT)
                files += f", {_EXPERIMENT}"
        write_json(draft / "diagnosis.json", content)
        explanation = found.explain(experiment)
        page = report.diagnosis_page(found, provenance, notes=measured.notes, explanation=explanation)
        (draft / "report.html").write_text(page, encoding="utf-8")
    sentences_shown = [*sentences(found, explanation), *found.warnings, *notes]
    lines = [headline(found), *(f"  {line}" for line in sentences_shown), written(out, f"{files}, report.html")]
    console.result("\n".join(lines), content)


def _separating(found: Diagnosis, seed: int, progress: Tell | None) -> tuple[Experiment | None, str]:
    """The experiment that separates competing effects within the limits of the log, and a sentence on it."""
    from diagnosis.experiment import competing_fits, separating_experiment
    from diagnosis.experiment.signal_design import Limits

    competing = competing_fits(found)
    if competing is None:
        return None, "No experiment was designed: that nothing is missing is more probable than any competing effect."
    try:
        experiment = separating_experiment(*competing, Limits.of(found.base.log), seed=seed, progress=progress)
    except BadParameter as refusal:
        return None, f"No experiment was designed: {refusal}"
    return experiment, str(experiment)


def predict(
    model: Path,
    options: LogOptions,
    *,
    effects: Path | None,
    window: float | None,
    measured: bool,
    page: Path | None,
    out: Path,
    console: Console,
) -> None:
    """Simulate a log in open loop and write run, time and output, and a page with measured and simulated drawn."""
    from antidrive.prediction import check_table, write_prediction
    from antidrive.prediction_page import prediction_page

    check_table(out)
    page = page or out.with_suffix(".html")
    servo = read_own_model(model, effects or options.fit.effects).model
    if window is not None and not (np.isfinite(window) and window > 0.0):
        raise BadParameter(f"--window must be a positive number of seconds, not {window:g}.")
    with whole_file(out) as draft, whole_file(page, option="--report", suffixes=PAGES) as drawn:
        read = _read(options, console)
        log = read.log if read.holdout is None else Log.merge([read.log, read.holdout])
        with console.progress("predicting") as progress:
            found = write_prediction(draft, log, servo, window=window, measured=measured, tell=progress)
        drawn.write_text(prediction_page(found, Provenance.now(console.words, log.sources)), encoding="utf-8")
    runs = [
        {"run": run.run, "label": run.label, "rms": error}
        for run, error in zip(log.runs, found.rms_errors, strict=True)
    ]
    content = {"file": str(out), "report": str(page), "unit": log.measured_unit, "runs": runs}
    console.result(f"{found}\nWritten: {out}, {page}", content)


def inspect(options: LogOptions, *, out: Path, console: Console) -> None:
    """Show what is understood of a log, and write log.toml and report.html."""
    from antidrive.inspection import inspected

    with console.progress("reading") as progress:
        found = inspected(options, progress)
    with whole_folder(out) as draft:
        (draft / "log.toml").write_text(found.log_file(out), encoding="utf-8")
        page = report.inspection_page(found, Provenance.now(console.words, found.log.sources))
        (draft / "report.html").write_text(page, encoding="utf-8")
    lines = [*found.sentences(), written(out, "log.toml, report.html")]
    if not found.log.faults:
        lines.append(f"Next: antidrive diagnose {out / 'log.toml'}")
    console.result("\n".join(lines), found.summary())


def simulate(
    scenario: str,
    options: Mapping[str, Any],
    *,
    model: Path | None,
    effects: Path | None,
    out: Path,
    seed: int,
    console: Console,
) -> None:
    """Run a scenario on the rig and write trajectory.csv, summary.json and report.html."""
    from antidrive.experiments.outcome import Outcome
    from antidrive.scenario_file import read_scenario_file

    plan, design = (
        read_scenario_file(scenario),
        _design(options, None if model is None else read_own_model(model, effects)),
    )
    with whole_folder(out) as draft:
        with console.progress(f"simulating {plan.name}") as progress:
            result = plan.run(design, seed, progress)
        result.table().to_csv(draft / "trajectory.csv", index=False, float_format="%.10g")
        write_json(draft / "summary.json", result.summary())
        provenance = Provenance.now(console.words)
        if isinstance(result, Outcome):
            page = report.experiment_page(result, provenance)
        else:
            page = report.closed_loop_page(result, provenance)
        (draft / "report.html").write_text(page, encoding="utf-8")
    lines = [*result.sentences(), written(out, "trajectory.csv, summary.json, report.html")]
    console.result("\n".join(lines), result.summary())


def _design(typed: Mapping[str, Any], known: ModelFile | None) -> Design:
    """The design of a closed loop; without drive options and gears in the model, the drives are those of the rig."""
    from antidrive.cli_drive_options import DRIVES, controller_numbers
    from antidrive.drives import drives
    from antidrive.scenario_file import Design

    of_model = known is not None and (known.gears is not None or known.model.axis == "linear")
    train = drives(typed, known)[0] if of_model or any(name in typed for name in DRIVES) else None
    friction = {} if known is None or known.friction_std is None else {"friction_std": known.friction_std}
    options = {**friction, **controller_numbers(typed)}
    return Design(model=None if known is None else known.model, train=train, options=options)


def effects(name: str | None, *, out: Path | None, console: Console) -> None:
    """List the catalogue, or describe one effect of it, and write gallery.html if there is a folder for it."""
    from antidrive import gallery
    from plant.effects import catalogue

    if name is not None and name not in catalogue:
        raise BadParameter(f"{name!r} is no effect; {suggestion(name, catalogue)}")
    lines = [gallery.table() if name is None else gallery.sheet(catalogue[name])]
    if out is not None:
        with whole_folder(out) as draft, console.progress("drawing every effect") as progress:
            page = gallery.gallery_page(Provenance.now(console.words), progress=progress)
            (draft / "gallery.html").write_text(page, encoding="utf-8")
        lines.append(written(out, "gallery.html"))
    shown = catalogue.values() if name is None else (catalogue[name],)
    console.result("\n".join(lines), {"effects": [gallery.facts(kind) for kind in shown]})


def demo(*, out: Path, seed: int, console: Console) -> None:
    """Run the whole chain on a synthetic log of the rig."""
    from antidrive.demo import run_demo, write_log

    with whole_folder(out) as draft:
        with console.progress("recording a synthetic log in the test-bench simulation") as progress:
            done = run_demo(seed=seed, progress=progress)
        write_log(done.log, draft / "log.csv")
        write_log(done.validation, draft / "validation.csv")
        done.base_model.write(draft / "base-model.json")
        done.model.write(draft / "model.json")
        write_json(draft / "diagnosis.json", done.diagnosis.to_dict())
        write_json(draft / "summary.json", done.summary())
        page = report.demo_page(done, Provenance.now(console.words, done.diagnosis.base.log.sources))
        (draft / "report.html").write_text(page, encoding="utf-8")
    files = "log.csv, validation.csv, diagnosis.json, model.json, base-model.json, summary.json, report.html"
    again = f"Try it yourself: antidrive diagnose {out / 'log.csv'} --holdout {out / 'validation.csv'}"
    lines = [*done.sentences(), written(out, files), again]
    console.result("\n".join(lines), done.summary())


def _read(options: LogOptions, console: Console) -> Measured:
    with console.progress("reading") as progress:
        return options.read(progress)


def _base(path: Path | None, own: Sequence[type[Effect]]) -> ServoModel | None:
    return None if path is None else read_model(path, own).model


def _data_lines(log: Log, unidentifiable: Sequence[str]) -> list[str]:
    return [
        *(f"  warning: {text}" for text in (*log.warnings, *unidentifiable)),
        *(f"  repaired: {text}" for text in log.repairs),
        *(f"  note: {text}" for text in log.notes),
    ]
