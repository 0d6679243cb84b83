"""Report of a closed loop on the rig: numbers, sentences, a table and a figure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from antidrive.scenario import Scenario
from diagnosis.explanation.wording import measured
from mpc import ClosedLoopResult
from plant.result_display import Drawn
from plant.units import axis_quantities

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedLoopRun(Drawn):
    """A closed loop, and the loops it is compared with.

    Attributes:
        title: for users.
        scenario: the simulated scenario.
        result: its result.
        min_torque: minimum pinion torque required of the controller [N m].
        max_torque: maximum pinion torque [N m].
        single: the same motion with a single drive, if it was compared.
        intact: the same motion with both drives throughout, if one was lost.
        notes: remarks on the machine, in sentences.
        again: summaries of repeated runs with different encoder noise.
    """

    title: str
    scenario: Scenario
    result: ClosedLoopResult
    min_torque: float
    max_torque: float
    single: ClosedLoopResult | None = None
    intact: ClosedLoopResult | None = None
    again: tuple[dict[str, Any], ...] = ()
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        """The results in sentences."""
        return "\n".join(self.sentences())

    def table(self) -> pd.DataFrame:
        """The trajectory, one row per sample, SI units."""
        beside: dict[str, Any] = {}
        if self.single is not None:
            beside |= {"single_drive_angle": self.single.angle, "single_drive_torque": self.single.torques[:, 0]}
        if self.intact is not None:
            beside |= {"angle_without_loss": self.intact.angle}
        return self.result.to_frame().assign(**beside)

    def summary(self) -> dict[str, Any]:
        """The numbers of the run, SI units, and their scatter if it was repeated."""
        found = self._one_summary()
        return found if not self.again else {**found, "runs": 1 + len(self.again), "std": self.scatter()}

    def scatter(self) -> dict[str, float]:
        """Standard deviation of each number over all runs, which differ in the encoders' noise."""
        runs = [flat(found) for found in (self._one_summary(), *self.again)]
        names = [name for name, value in runs[0].items() if name != "schema" and _is_number(value)]
        columns = {name: [run.get(name) for run in runs] for name in names}
        return {
            name: float(np.std(np.array(column, dtype=float), ddof=1))
            for name, column in columns.items()
            if len(column) > 1 and all(map(_is_number, column))
        }

    def _one_summary(self) -> dict[str, Any]:
        r, kept = self.result, self._preloaded()
        found: dict[str, Any] = {
            "schema": 1,
            "scenario": self.scenario.name,
            "synthetic": True,
            "tracking_rms": r.tracking_rms,
            "largest_error": float(np.max(np.abs(r.angle - r.reference))),
            "final_error": float(np.mean((r.angle - r.reference)[-20:])),
            "least_preload_margin": float(np.min(r.contact_torques[kept])) if kept.stop else None,
            "contact_lost": bool(np.min(r.contact_torques) <= 0.0),
            "copper_loss": r.copper_loss,
            "samples": int(r.time.size),
            "degraded_samples": r.degraded,
        }
        if self.scenario.drive_loss is not None:
            found |= self._loss(kept.stop)
        if self.single is not None:
            alone = self.single.contact_torques[:, 0]
            found["samples_without_contact"] = int(np.sum(np.any(r.contact_torques <= 0.0, axis=1)))
            found["single_drive"] = {
                "tracking_rms": self.single.tracking_rms,
                "samples_without_contact": int(np.sum(alone == 0.0)),
                "impact_on_opposite_flank": float(max(-np.min(alone), 0.0)),
            }
        return found

    def _loss(self, first: int) -> dict[str, Any]:
        """Errors after the loss of a drive at sample `first`, and in the same samples without the loss."""
        error = (self.result.angle - self.result.reference)[first:]
        if error.size == 0:
            return {"backlash_control": "kept"}
        after = float(np.sqrt(np.mean(error**2)))
        found = {"tracking_rms_after_loss": after, "largest_error_after_loss": float(np.max(np.abs(error)))}
        if self.intact is not None:
            spared = (self.intact.angle - self.intact.reference)[first:]
            without = float(np.sqrt(np.mean(spared**2)))
            largest = float(np.max(np.abs(spared)))
            found |= {"tracking_rms_without_loss": without, "largest_error_without_loss": largest}
            found["error_growth"] = after / without
        lost = any("backlash control with it" in status for status in self.result.status)
        return {**found, "backlash_control": "lost" if lost else "kept"}

    def _preloaded(self) -> slice:
        """The samples before the loss of a drive."""
        loss = self.scenario.drive_loss
        count = self.result.time.size
        return slice(0, count if loss is None else min(count, round(loss.time / self.scenario.sample_time)))

    def sentences(self) -> list[str]:
        """Results in sentences."""
        s, texts = flat(self._one_summary()), dict(self.numbers())
        lines = [
            *self.notes,
            f"Tracking error {texts['tracking_rms']} rms, {texts['largest_error']} at most, in "
            f"{self.scenario.duration:g} s of test-bench simulation.",
        ]
        margin = s["least_preload_margin"]
        if self.result.torques.shape[1] == 1:
            apart = int(np.sum(self.result.contact_torques <= 0.0))
            lines.append(f"A single drive has no preload: contact is lost in {apart} of {s['samples']} samples.")
        elif margin is not None:
            held = "contact was never lost" if margin > 0.0 else "contact was lost"
            while_both = "" if self.scenario.drive_loss is None else " while both drives worked"
            least = texts["least_preload_margin"]
            lines.append(f"Minimum contact torque{while_both}: {least} at the output gear; {held}.")
        if "tracking_rms_after_loss" in s:
            growth = ""
            if "error_growth" in s:
                growth = (
                    f", {texts['error_growth']} times the {texts['tracking_rms_without_loss']} without the loss "
                    f"(at most {texts['largest_error_after_loss']} and {texts['largest_error_without_loss']})"
                )
            lines.append(
                f"After the loss of drive {self.scenario.drive_loss.drive if self.scenario.drive_loss else ''} the "
                f"motion goes on with {texts['tracking_rms_after_loss']} rms{growth}; backlash control is "
                f"{s['backlash_control']}."
            )
        if self.single is not None:
            impact = texts["impact_on_opposite_flank_single_drive"]
            lines.append(
                f"Contact is lost in {texts['samples_without_contact']} samples with both drives and in "
                f"{texts['samples_without_contact_single_drive']} samples with one. One drive hits the opposite flank "
                f"with up to {impact}; its tracking error is {texts['tracking_rms_single_drive']} rms."
            )
        if s["degraded_samples"]:
            first = next(status for status in self.result.status if status != "optimal")
            lines.append(f"{texts['degraded_samples']} of {s['samples']} samples were not optimal ({first}).")
        if self.again:
            count = 1 + len(self.again)
            lines.append(
                f"± is the standard deviation over {count} runs with different encoder noise; numbers without "
                "it are the same in all runs."
            )
        return lines

    def numbers(self) -> list[tuple[str, str]]:
        """The summary as table rows: name, and value with unit and standard deviation over all runs."""
        _, rad, _, newton = axis_quantities(self.result.axis)
        units = {"copper": "N² m²", **dict.fromkeys(("tracking", "largest", "final"), rad)}
        units |= dict.fromkeys(("least", "impact"), newton)
        scatter, rows = self.scatter(), []
        for name, value in flat(self._one_summary()).items():
            if name in ("schema", "synthetic"):
                continue
            if isinstance(value, bool):
                agree = sum(value == flat(run)[name] for run in self.again) + 1
                over = f", in {agree} of {1 + len(self.again)} runs" if self.again else ""
                rows.append((name, ("yes" if value else "no") + over))
            elif isinstance(value, float | int):
                std = scatter.get(name)
                exact = f"{value:.4g} {units.get(name.split('_')[0], '')}".strip()
                rows.append((name, measured(value, std, units.get(name.split("_")[0], "")) if std else exact))
        return rows

    def figure(self) -> Any:
        """Reference and angle, error, pinion torques, contact torques."""
        limits = (-self.max_torque, -self.min_torque, self.min_torque, self.max_torque)
        return loop_figure(self.result, single=self.single, intact=self.intact, limits=limits)


def loop_figure(
    result: ClosedLoopResult,
    *,
    single: ClosedLoopResult | None = None,
    intact: ClosedLoopResult | None = None,
    limits: tuple[float, ...] = (),
) -> Any:
    """Figure of reference and angle, error, pinion torques with their limits, contact torques; with the other loops."""
    from antidrive.chart import AFTER, BEFORE, MEASURED, SECOND, THIRD
    from antidrive.figures import traces_figure

    angle, rad, torque, newton = axis_quantities(result.axis)
    angles = [("reference", MEASURED, result.reference), (angle, AFTER, result.angle)]
    errors = [(angle, AFTER, result.angle - result.reference)]
    if intact is not None:
        errors.append(("angle, nothing lost", MEASURED, intact.angle - intact.reference))
    if single is not None:
        angles.append(("angle, one drive", BEFORE, single.angle))
        errors.append(("angle, one drive", BEFORE, single.angle - single.reference))
    torques, flanks = (
        [(f"drive {i + 1}", (SECOND, THIRD)[i], column) for i, column in enumerate(both.T)]
        for both in (result.torques, result.contact_torques)
    )
    return traces_figure(
        result.time,
        [
            (f"{angle} [{rad}]", angles),
            (f"error [{rad}]", errors),
            ("pinion torque [N m]", torques),
            (f"contact {torque} [{newton}]", flanks),
        ],
        bounds={3: limits, 4: (0.0,)},
    )


def loop_sentences(result: ClosedLoopResult) -> list[str]:
    """Results of a loop, in sentences."""
    _, rad, _, newton = axis_quantities(result.axis)
    least, optimal = result.minimum_contact_torque, result.time.size - result.degraded
    contact = f"minimum contact torque {least:.3g} {newton}" if least > 0.0 else "contact was lost"
    return [
        f"Tracking error {result.tracking_rms:.3g} {rad} rms; {contact}.",
        f"{optimal} of {result.time.size} samples were optimal.",
    ]


def flat(summary: Mapping[str, Any]) -> dict[str, Any]:
    """A summary without nested parts; numbers of the single drive get their own names."""
    alone = {f"{name}_single_drive": value for name, value in summary.get("single_drive", {}).items()}
    return {name: value for name, value in summary.items() if not isinstance(value, dict)} | alone


def _is_number(value: Any) -> bool:
    return isinstance(value, float | int) and not isinstance(value, bool)
