"""Changes since a model was identified: parameters that changed beyond their errors, and new effects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import ndtri

from diagnosis.explanation.posterior_sentences import unexplained
from diagnosis.explanation.wording import title_of
from diagnosis.levels import INEXACT, SURE
from identification.log import Log
from identification.log_like import LogLike, log_of
from identification.simulation import free_simulation
from plant.model_file import ModelFile, model_of, read_model
from plant.result_display import Drawn
from plant.servo import ServoModel
from plant.uncertain_number import measured
from plant.units import printed

if TYPE_CHECKING:
    import pandas as pd

    from diagnosis.diagnosis import Diagnosis

_CHANCE = 0.01  # probability that any parameter is reported as changed if none has


@dataclass(frozen=True, kw_only=True)
class Change:
    """Earlier and present value of one parameter.

    Attributes:
        before, after: its value, each with its standard error; None if unknown.
        moved: whether the difference is significant, given the number of parameters, and larger than a hundredth of the
            parameter: no model is exact to less.
    """

    name: str
    unit: str
    before: float
    before_std: float | None
    after: float | None
    after_std: float | None
    moved: bool

    @property
    def errors(self) -> float | None:
        """Change in standard errors of the difference; None if they are not known."""
        if self.after is None or not self.after_std:
            return None
        return (self.after - self.before) / float(np.hypot(self.before_std or 0.0, self.after_std))

    def __str__(self) -> str:
        """Text in one line."""
        if self.after is None:
            return f"{self.name}: this log does not determine it (it was {self.before:.4g} {printed(self.unit)})"
        change = "" if not self.before else f"{100.0 * (self.after / self.before - 1.0):+.3g} %"
        size = abs(self.errors or 0.0)
        errors = "" if self.errors is None else f"{size:.{0 if size >= 10.0 else 1}f} standard errors"
        about = ", ".join(part for part in (change, errors) if part)
        was = measured(self.before, self.before_std, self.unit)
        now = measured(self.after, self.after_std, self.unit)
        return f"{self.name}: {was} -> {now}{f' ({about})' if about else ''}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison(Drawn):
    """A known model compared with a new log.

    Attributes:
        changes: one for each parameter of the known model that the new model has too.
        diagnosis: of the log, starting from the known model.
        new: names of new effects with high probability.
        possible: names of new effects with lower probability.
        gone: names of effects of the known model that a new effect has replaced.
        error_before, error_after: rms error of an open-loop simulation of the log with the known and the new model.
        unit: of these.
    """

    changes: tuple[Change, ...]
    diagnosis: Diagnosis
    new: tuple[str, ...]
    possible: tuple[str, ...]
    gone: tuple[str, ...]
    error_before: float
    error_after: float
    unit: str

    @property
    def model(self) -> ServoModel:
        """The new model."""
        return self.diagnosis.model

    def headline(self) -> str:
        """The changes in a few words."""
        moved = [change.name.replace("_", " ").replace(".", ": ") for change in self.changes if change.moved]
        new = [title_of(name) for name in self.new]
        parts = [f"Changed: {', '.join(moved)}"] * bool(moved) + [f"New: {', '.join(new)}"] * bool(new)
        if self.possible:
            parts.append(f"Perhaps missing: {', '.join(title_of(name) for name in self.possible)}")
        elif not new and self.diagnosis.verdict == "unknown":
            parts.append("A model error that no effect explains")
        return "; ".join(parts) or "Nothing has changed"

    def sentences(self) -> list[str]:
        """The changes, the new effects, and the error of the known model on this log."""
        moved = [change for change in self.changes if change.moved]
        lines = [f"Changed: {change}" for change in moved] or ["No parameter has changed beyond its error."]
        causes = {cause.effect: cause for cause in self.diagnosis.causes}
        effects = {name: f"{title_of(name)}, probability {_share(causes[name].probability)}" for name in causes}
        lines += [f"New: {effects[name]}" for name in self.new]
        before = "the known model lacks it, perhaps from the start"
        lines += [f"Perhaps new: {effects[name]}; {before}." for name in self.possible]
        if not (self.new or self.possible):
            lines.append(
                "No effect is new."
                if self.diagnosis.verdict != "unknown"
                else "The known model has an error that no effect explains, perhaps from the start: "
                f"{unexplained(self.diagnosis)}."
            )
        lines += [f"Gone: {title_of(name)}, replaced by a new effect" for name in self.gone]
        lines += [f"Unchanged: {change}" for change in self.changes if not change.moved]
        lines.append(
            f"In simulation of this log the error of the known model is {self.error_before:.3g} {self.unit} rms, "
            f"of the new one {self.error_after:.3g} {self.unit} rms."
        )
        if all(change.before_std is None for change in self.changes):
            lines.append("The known model has no standard errors; its parameters are taken as exact.")
        return lines

    def __str__(self) -> str:
        """The sentences."""
        return "\n".join(self.sentences())

    def to_frame(self) -> pd.DataFrame:
        """A row for each parameter: before, after, their errors, and whether it changed."""
        import pandas as pd

        return pd.DataFrame([_row(change) for change in self.changes]).set_index("name")

    def to_dict(self) -> dict[str, Any]:
        """The content of comparison.json."""
        return {
            "schema": 1,
            "changes": [_row(change) for change in self.changes],
            "new": list(self.new),
            "possible": list(self.possible),
            "gone": list(self.gone),
            "verdict": self.diagnosis.verdict,
            "rms": {"before": self.error_before, "after": self.error_after, "unit": self.unit},
        }


def compare(
    model: ModelFile | ServoModel | str | Path,
    log: LogLike,
    *,
    holdout: Log | None = None,
    progress: Callable[[str], None] | None = None,
    **known: Any,
) -> Comparison:
    """Changes since a model was identified.

    The log is diagnosed with the known model as the start. The present parameters are those of the extended model, so
    that a new effect does not appear as a change of the other parameters.

    Args:
        model: the earlier model, or the path of its file, which has the standard errors.
        log: recorded since.
        holdout: validation runs of the diagnosis.
        progress: called with a line of text now and then.
        known: further arguments of `diagnosis.diagnose`.

    Raises:
        BadParameter, MalformedLog: as `diagnosis.diagnose` does.
    """
    from diagnosis import diagnose

    before = read_model(model) if isinstance(model, str | Path) else model
    if not isinstance(before, ModelFile):
        before = ModelFile(model=model_of(before), std={})
    read = log_of(log)
    found = diagnose(read, before.model, holdout, progress=progress, **known)
    kept = {effect.name for effect in found.model.effects}
    had = {effect.name for effect in before.model.effects}
    added = [cause for cause in found.causes if cause.effect not in had]
    errors = [_rms(read, servo) for servo in (before.model, found.model)]
    return Comparison(
        changes=_changes(before, found),
        diagnosis=found,
        new=tuple(cause.effect for cause in added if cause.probability > SURE),
        possible=tuple(cause.effect for cause in added if cause.probability <= SURE),
        gone=tuple(effect.name for effect in before.model.effects if effect.name not in kept),
        error_before=errors[0],
        error_after=errors[1],
        unit=read.measured_unit,
    )


def _changes(before: ModelFile, found: Diagnosis) -> tuple[Change, ...]:
    now = {line.name: line for line in found.extended.parameters}
    changes = [
        Change(
            name=spec.name,
            unit=spec.unit,
            before=float(value),
            before_std=before.std.get(spec.name),
            after=now[spec.name].value,
            after_std=now[spec.name].std,
            moved=False,
        )
        for spec, value in zip(before.model.parameters, before.model.values, strict=True)
        if spec.name in now and not now[spec.name].fixed
    ]
    limit = significant(changes)
    return tuple(replace(change, moved=_has_moved(change, limit)) for change in changes)


def significant(changes: Sequence[Change]) -> float:
    """Standard errors above which a change of one of these parameters is no chance (Bonferroni correction)."""
    with_error = [change for change in changes if change.errors is not None]
    return float(-ndtri(0.5 * _CHANCE / max(len(with_error), 1)))


def _has_moved(change: Change, limit: float) -> bool:
    """Whether a change is significant and larger than what any model is exact to."""
    if change.errors is None or change.after is None:
        return False
    size = max(abs(change.before), abs(change.after))
    return abs(change.errors) > limit and abs(change.after - change.before) > INEXACT * size


def _rms(log: Log, model: ServoModel) -> float:
    squares = [
        (run.measured - simulated)[run.valid] ** 2
        for run, simulated in zip(log.runs, free_simulation(log, model), strict=True)
    ]
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def _row(change: Change) -> dict[str, Any]:
    return {**vars(change), "errors": change.errors}


def _share(probability: float) -> str:
    return "above 0.99" if probability > 0.99 else f"{probability:.2f}"
