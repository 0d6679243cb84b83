"""The report: one self-contained page that opens offline, to be read from top to bottom."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from antidrive import figures
from antidrive.capability import ROTARY, Units
from antidrive.chart import Bars, Figure
from antidrive.closed_loop_run import loop_figure, loop_sentences
from antidrive.equations import model_equations
from antidrive.experiment_figures import picture_figure
from antidrive.experiments.outcome import Outcome
from antidrive.html_page import page
from antidrive.inspection import Inspection, inspection_figures
from antidrive.prediction import quantity
from antidrive.provenance import Provenance
from diagnosis.diagnosis import Diagnosis
from diagnosis.explanation import Explanation, Reason
from diagnosis.explanation.posterior_sentences import posterior_sentences, set_title
from diagnosis.explanation.summary import headline, sentences
from diagnosis.explanation.wording import (
    effect_of,
    measured,
    percent,
    sentence_case,
    title_of,
    torque_or_force,
)
from diagnosis.holdout import gain_errors
from diagnosis.result import LISTED, Cause, Gain
from identification.fit_result import Fit, FittedParameter, correlations
from identification.standard_errors import bandwidth_std
from plant.effects.effect import Array
from plant.units import axis_quantities

if TYPE_CHECKING:
    from allocation import CapabilityMap
    from antidrive.closed_loop_run import ClosedLoopRun
    from antidrive.demo import Demo
    from mpc import ClosedLoopResult

_NAMES = {"least_preload_margin": "minimum contact torque", "copper_loss": "copper-loss index"}
_RUNS_DRAWN = 3  # validation runs that are drawn; the numbers cover all
_BARS = 6  # number of most probable sets drawn


def diagnosis_page(
    diagnosis: Diagnosis, provenance: Provenance, notes: Sequence[str] = (), explanation: Explanation | None = None
) -> str:
    """The page of a diagnosis, with its explanation if that has been computed already."""
    content = _diagnosis(diagnosis, notes, explanation or diagnosis.explain())
    return page("diagnosis", provenance, headline(diagnosis), diagnosis=content)


def fit_page(
    fit: Fit,
    simulated: Sequence[Array],
    provenance: Provenance,
    notes: Sequence[str] = (),
    warnings: Sequence[str] = (),
) -> str:
    """The page of a fit; `simulated` has one free simulation (T,) per run, `warnings` the limits of the log."""
    unit = fit.log.measured_unit
    runs = list(zip(fit.log.runs, simulated, strict=True))
    worst = sorted(runs, key=lambda pair: -_rms((pair[0].measured - pair[1])[pair[0].valid]))[:_RUNS_DRAWN]
    drawn = [
        (run.label, figures.fit_figure(run.time, np.where(run.valid, run.measured, np.nan), y, quantity(fit.log), unit))
        for run, y in worst
    ]
    content = {
        "unit": unit,
        "inverse": fit.log.response == "torque",
        "equations": model_equations(fit.model),
        "noise": measured(fit.noise_std, fit.noise_std / np.sqrt(2.0 * fit.samples), unit),
        "samples": fit.samples,
        "runs": len(runs),
        "bandwidth": measured(fit.bandwidth, bandwidth_std(fit), "rad/s") if fit.bandwidth else "",
        "failed": fit.failed,
        "figures": drawn,
        "parameters": [_parameter(p) for p in fit.parameters],
        "correlations": correlations(fit, 0.5),
        "data": _data(fit, warnings, notes),
    }
    lost = fit.unidentifiable
    title = f"{sum(not p.fixed and p.value is not None for p in fit.parameters)} parameters fitted"
    if fit.failed is not None:
        title = "the fit failed"
    elif lost:
        title += f"; this log cannot tell {', '.join(lost)}"
    return page("fit", provenance, title, fit=content)


def inspection_page(found: Inspection, provenance: Provenance) -> str:
    """The page of a log that was read but not fitted."""
    log = found.log
    content = {
        "tables": found.tables,
        "figures": [(label, figure) for label, figure in inspection_figures(log)],
        "data": {"warnings": (*log.faults, *log.warnings), "repairs": log.repairs, "notes": log.notes},
    }
    return page("inspection", provenance, "What is understood of the log", inspection=content)


def experiment_page(found: Outcome, provenance: Provenance) -> str:
    """The page of one of the paper's experiments."""
    content = {
        "sentences": found.sentences(),
        "comparison": found.comparison,
        "pictures": [(picture_figure(drawn), drawn.caption) for drawn in found.pictures],
    }
    return page("experiment", provenance, found.title, experiment=content)


def closed_loop_page(trial: ClosedLoopRun, provenance: Provenance) -> str:
    """The page of a closed loop."""
    return page("closed_loop", provenance, trial.title, trials=[_trial(trial)])


def loop_page(result: ClosedLoopResult, provenance: Provenance) -> str:
    """The page of a closed loop simulated in Python."""
    _, length, _, newton = axis_quantities(result.axis)
    title, error = "Closed loop", result.angle - result.reference
    numbers = [
        ("tracking rms", f"{result.tracking_rms:.4g} {length}"),
        ("largest error", f"{float(np.max(np.abs(error))):.4g} {length}"),
        ("minimum contact torque", f"{result.minimum_contact_torque:.4g} {newton}"),
        ("copper-loss index", f"{result.copper_loss:.4g} N² m²"),
    ]
    content = {"title": title, "note": "", "sentences": loop_sentences(result), "figure": loop_figure(result)}
    return page("closed_loop", provenance, title, trials=[{**content, "numbers": numbers}])


def capability_page(
    found: CapabilityMap, sentences: Sequence[str], provenance: Provenance, units: Units = ROTARY
) -> str:
    """The page of a capability map."""
    drawn = figures.capability_figure(found, units)
    return page(
        "capability", provenance, "What the drives can do without backlash", sentences=sentences, figures=[drawn]
    )


def demo_page(demo: Demo, provenance: Provenance) -> str:
    """The page of the demo: the diagnosis, then both closed loops."""
    return page(
        "demo",
        provenance,
        headline(demo.diagnosis),
        story=demo.sentences()[1:],
        diagnosis=_diagnosis(
            demo.diagnosis,
            ("synthetic log from the test-bench simulation, with effects hidden in it",),
            demo.diagnosis.explain(),
        )
        | {"sentences": ()},
        trials=[_trial(trial) for trial in demo.trials],
    )


def _diagnosis(diagnosis: Diagnosis, notes: Sequence[str], explanation: Explanation) -> dict[str, Any]:
    """Content of the template for a diagnosis."""
    extended = diagnosis.extended is not diagnosis.base
    shown, unit = quantity(diagnosis.base.log), diagnosis.base.log.measured_unit
    after = {curve.variable: curve for curve in diagnosis.residual_after.curves} if extended else {}
    curves = [
        (
            curve.variable,
            percent(max(curve.share, 0.0), curve.share_std),
            figures.curve_figure(curve, after.get(curve.variable), diagnosis.residual_before.unit),
        )
        for curve in diagnosis.residual_before.curves
    ]
    replays = sorted(diagnosis.replays, key=lambda r: -_rms((r.measured - r.before)[r.valid]))[:_RUNS_DRAWN]
    gain = diagnosis.gain
    return {
        "verdict": diagnosis.verdict.replace("_", " "),
        "sentences": sentences(diagnosis, explanation),
        "lacked": explanation.missing,
        "outcome": explanation.outcome,
        "extended": extended,
        "held_out": gain is not None,
        "gain": gain,
        "errors": [] if gain is None else _errors(diagnosis, gain, extended),
        "unit": unit,
        "inverse": diagnosis.base.log.response == "torque",
        "replays": [
            (replay.label, figures.replay_figure(replay, shown, unit, extended=extended)) for replay in replays
        ],
        "others": len(diagnosis.replays) - len(replays),
        "acting": torque_or_force(diagnosis.residual_before.unit),
        "missing": figures.residual_figure(diagnosis.residual_before),
        "curves": curves,
        "sets": _sets(diagnosis),
        "causes": [_cause(diagnosis, c, r) for c, r in zip(diagnosis.causes, explanation.reasons, strict=False)],
        "without_cause": [] if diagnosis.causes else [_reason(reason) for reason in explanation.reasons],
        "floor": ""
        if gain is None
        else f"{gain.floor_name} {measured(gain.noise_floor, gain_errors(diagnosis).noise_floor, gain.unit)}",
        "gain_bars": None if gain is None else figures.gain_bars(gain, gain_errors(diagnosis), extended=extended),
        "equations": model_equations(diagnosis.model),
        "parameters": [_parameter(p) for p in diagnosis.extended.parameters],
        "rejected": [(sentence_case(title_of(r.effect, diagnosis)), r.reason) for r in diagnosis.rejected],
        "data": _data(diagnosis.base, diagnosis.warnings, notes),
    }


def _sets(diagnosis: Diagnosis) -> tuple[tuple[str, ...], Bars]:
    """The posterior over sets of effects: sentences, and a bar for each set that is not improbable."""
    listed = [each for each in diagnosis.sets if each.probability >= LISTED][:_BARS]
    shares = [(set_title(each, diagnosis), each.probability, percent(each.probability)) for each in listed]
    return posterior_sentences(diagnosis), figures.probability_bars(shares)


def _errors(diagnosis: Diagnosis, gain: Gain, extended: bool) -> list[tuple[str, str]]:
    """The validation error of each model and the noise floor, with standard errors and descriptions."""
    error = gain_errors(diagnosis)
    errors = [(gain.held_out_rms_before, error.before, "rms error on validation data, base model")]
    if extended:
        errors.append((gain.held_out_rms_after, error.after, "rms error on validation data, extended model"))
    errors.append((gain.noise_floor, error.noise_floor, gain.floor_name))
    return [(measured(value, std, gain.unit), what) for value, std, what in errors]


def _cause(diagnosis: Diagnosis, cause: Cause, reason: Reason) -> dict[str, Any]:
    effect = effect_of(diagnosis, cause.effect)
    return _reason(reason) | {
        "title": sentence_case(title_of(cause.effect, diagnosis)),
        "stage": effect.stage.value if effect else "",
        "confused": [title_of(name) for name in (effect.confused_with if effect else ())],
        "gain": f"{percent(cause.gain, cause.gain_std)} smaller" if cause.gain > 0 else "no smaller",
    }


def _reason(reason: Reason) -> dict[str, Any]:
    """Sentences and figures on a reported effect."""
    drawn: list[tuple[Figure, str]] = []
    if reason.cumulative_evidence is not None:
        caption = (
            "Where along the log the evidence comes from. The log Bayes factor is another number: it also allows for "
            "an unmodelled torque, for the prior, and for other effects in its place."
        )
        drawn.append((figures.evidence_figure(reason.cumulative_evidence), caption))
    if reason.residual_over_variable is not None:
        quantity = torque_or_force(reason.residual_over_variable.torque_unit)
        caption = f"Residual {quantity} without and with this effect: measured means with 95 % errors."
        drawn.append((figures.cause_figure(reason.residual_over_variable), caption))
    return {"title": reason.title, "sentences": reason.sentences, "pictures": drawn}


def _parameter(p: FittedParameter) -> dict[str, str]:
    flags = [
        *(["fixed"] if p.fixed else []),
        *(["at bound"] if p.at_bound else []),
        *(["this log cannot tell it"] if p.value is None else []),
    ]
    effect, _, name = p.name.rpartition(".")
    return {
        "name": f"{title_of(effect)}: {name.replace('_', ' ')}" if effect else name.replace("_", " "),
        "value": "—" if p.value is None else measured(p.value, p.std, p.unit.removesuffix("-")),
        "flags": ", ".join(flags),
    }


def _trial(trial: ClosedLoopRun) -> dict[str, Any]:
    sentences = trial.sentences()
    return {
        "title": trial.title,
        "note": sentences.pop() if trial.again else "",
        "sentences": sentences,
        "figure": trial.figure(),
        "numbers": [(_NAMES.get(name, name.replace("_", " ")), value) for name, value in trial.numbers()],
    }


def _data(fit: Fit, warnings: Sequence[str], notes: Sequence[str]) -> dict[str, Sequence[str]]:
    not_warnings = (*fit.log.repairs, *notes, *fit.log.notes)
    return {
        "warnings": tuple(text for text in dict.fromkeys((*warnings, *fit.log.warnings)) if text not in not_warnings),
        "repairs": fit.log.repairs,
        "notes": tuple(dict.fromkeys((*notes, *fit.log.notes))),
    }


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
