"""Run a scenario: the controller of `mpc` in closed loop around the rig, and what came of it in numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from antidrive.drive_loss import loop_with_drive_loss
from antidrive.scenario import Scenario
from antidrive.time_left import Parts, Tell
from diagnosis.holdout import rms
from mpc import ClosedLoopResult, Controller, closed_loop
from plant.errors import BadParameter
from plant.rig import Rig
from plant.servo import ServoModel

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """A closed loop and what it was for.

    Attributes:
        title: for people.
        scenario: what was asked.
        result: what happened.
        min_torque: least pinion torque that the controller had to keep [N m].
        max_torque: greatest [N m].
        single: the same motion with one drive alone, when it was compared.
        intact: the same motion with both drives throughout, when one was lost.
    """

    title: str
    scenario: Scenario
    result: ClosedLoopResult
    min_torque: float
    max_torque: float
    single: ClosedLoopResult | None = None
    intact: ClosedLoopResult | None = None

    def table(self) -> pd.DataFrame:
        """The trajectory, one row a sample, SI units."""
        import pandas as pd

        r = self.result
        columns: dict[str, Any] = {
            "time": r.time,
            "reference": r.reference,
            "angle": r.angle,
            "measured_angle": r.measured_angle,
            "velocity": r.velocity,
            "torque_1": r.torques[:, 0],
            "torque_2": r.torques[:, 1],
            "flank_torque_1": r.flank_torques[:, 0],
            "flank_torque_2": r.flank_torques[:, 1],
            "disturbance_estimate": r.disturbance,
            "status": r.status,
        }
        if self.single is not None:
            columns |= {"single_drive_angle": self.single.angle, "single_drive_torque": self.single.torques[:, 0]}
        if self.intact is not None:
            columns |= {"angle_without_loss": self.intact.angle}
        return pd.DataFrame(columns)

    def summary(self) -> dict[str, Any]:
        """The numbers of the trial, SI units."""
        r, kept = self.result, self._preloaded()
        found: dict[str, Any] = {
            "schema": 1,
            "scenario": self.scenario.name,
            "synthetic": True,
            "tracking_rms": r.tracking_rms,
            "largest_error": float(np.max(np.abs(r.angle - r.reference))),
            "final_error": float(np.mean((r.angle - r.reference)[-20:])),
            "least_preload_margin": float(np.min(r.flank_torques[kept])) if kept.stop else None,
            "teeth_parted": bool(np.min(r.flank_torques) <= 0.0),
            "heat": r.heat,
            "samples": int(r.time.size),
            "degraded_samples": r.degraded,
        }
        if self.scenario.drive_loss is not None:
            found |= self._loss(kept.stop)
        if self.single is not None:
            alone = self.single.flank_torques[:, 0]
            found["samples_apart"] = int(np.sum(np.any(r.flank_torques <= 0.0, axis=1)))
            found["single_drive"] = {
                "tracking_rms": self.single.tracking_rms,
                "samples_apart": int(np.sum(alone == 0.0)),
                "hardest_hit_on_far_flank": float(max(-np.min(alone), 0.0)),
            }
        return found

    def _loss(self, first: int) -> dict[str, Any]:
        """What the loss of a drive at sample `first` cost: errors from then on, and without it in the same samples."""
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
        """The samples in which both drives worked."""
        loss = self.scenario.drive_loss
        count = self.result.time.size
        return slice(0, count if loss is None else min(count, round(loss.time / self.scenario.sample_time)))

    def sentences(self) -> list[str]:
        """What happened, in words."""
        s = self.summary()
        lines = [
            f"Tracking error {s['tracking_rms']:.3g} rad rms, {s['largest_error']:.3g} rad at most, "
            f"on the rig (synthetic) over {self.scenario.duration:g} s."
        ]
        margin = s["least_preload_margin"]
        if margin is not None:
            held = "the teeth never parted" if margin > 0.0 else "the teeth parted"
            while_both = "" if self.scenario.drive_loss is None else " while both drives worked"
            lines.append(f"Least flank torque on the rig{while_both}: {margin:.3g} N m at the follower; {held}.")
        if "tracking_rms_after_loss" in s:
            growth = ""
            if "error_growth" in s:
                growth = (
                    f", {s['error_growth']:.2g} times the {s['tracking_rms_without_loss']:.3g} rad without the loss "
                    f"(at most {s['largest_error_after_loss']:.3g} and {s['largest_error_without_loss']:.3g} rad)"
                )
            lines.append(
                f"After the loss of drive {self.scenario.drive_loss.drive if self.scenario.drive_loss else ''} the "
                f"motion goes on with {s['tracking_rms_after_loss']:.3g} rad rms{growth}; backlash control is "
                f"{s['backlash_control']}."
            )
        if "single_drive" in s:
            one = s["single_drive"]
            lines.append(
                f"Teeth apart in {s['samples_apart']} samples with both drives, in {one['samples_apart']} with one, "
                f"which then hits the far flank with up to {one['hardest_hit_on_far_flank']:.3g} N m; tracking error "
                f"with one drive: {one['tracking_rms']:.3g} rad rms."
            )
        if s["degraded_samples"]:
            first = next(status for status in self.result.status if status != "optimal")
            lines.append(f"{s['degraded_samples']} of {s['samples']} samples were not optimal ({first}).")
        return lines

    def numbers(self) -> list[tuple[str, str]]:
        """The summary for a table: name and value, rms errors with their standard error."""
        units = {"heat": "N² m²", "tracking": "rad", "largest": "rad", "final": "rad", "least": "N m", "hardest": "N m"}
        summary = self.summary()
        summary |= {f"{name}_single_drive": value for name, value in summary.pop("single_drive", {}).items()}
        loss = self._preloaded().stop
        loops = {
            "tracking_rms": (self.result, 0),
            "tracking_rms_single_drive": (self.single, 0),
            "tracking_rms_after_loss": (self.result, loss),
            "tracking_rms_without_loss": (self.intact, loss),
        }
        errors = {name: loop.angle[k:] - loop.reference[k:] for name, (loop, k) in loops.items() if loop is not None}
        scatter = {name: f" ± {rms(errors[name])[1]:.1g}" for name in errors.keys() & summary.keys()}
        rows = []
        for name, value in summary.items():
            if isinstance(value, float):
                unit = units.get(name.split("_")[0], "")
                rows.append((name, f"{value:.4g}{scatter.get(name, '')} {unit}".strip()))
            elif isinstance(value, int) and name != "schema":
                rows.append((name, {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)))
        return rows

    def figure(self) -> Any:
        """Reference and angle, error, pinion torques, flank torques."""
        from antidrive.figures import AFTER, BEFORE, MEASURED, SECOND, THIRD, traces_figure

        r = self.result
        angles = [("reference", MEASURED, r.reference), ("angle", AFTER, r.angle)]
        errors = [("angle", AFTER, r.angle - r.reference)]
        if self.intact is not None:
            errors.append(("angle, nothing lost", MEASURED, self.intact.angle - self.intact.reference))
        if self.single is not None:
            angles.append(("angle, one drive", BEFORE, self.single.angle))
            errors.append(("angle, one drive", BEFORE, self.single.angle - self.single.reference))
        torques = [("drive 1", SECOND, r.torques[:, 0]), ("drive 2", THIRD, r.torques[:, 1])]
        flanks = [("drive 1", SECOND, r.flank_torques[:, 0]), ("drive 2", THIRD, r.flank_torques[:, 1])]
        return traces_figure(
            r.time,
            [
                ("angle [rad]", angles),
                ("error [rad]", errors),
                ("pinion torque [N m]", torques),
                ("preload margin [N m]", flanks),
            ],
            bounds={3: (-self.max_torque, -self.min_torque, self.min_torque, self.max_torque), 4: (0.0,)},
        )


def run_scenario(
    scenario: Scenario, *, model: ServoModel | None = None, seed: int = 0, tell: Tell | None = None
) -> Trial:
    """Close the loop on the rig of a scenario.

    Args:
        scenario: what to do.
        model: design model of the controller; by default eq. (4) with the rig's inertia, gravity and viscous friction.
        seed: of the encoder's noise.
        tell: called with a line of text at each hundredth.

    Raises:
        BadParameter: a number of the scenario that the rig or the controller cannot use.
    """
    rig = scenario.machine()
    design = rigid_model(rig) if model is None else model

    def controller() -> Controller:
        return Controller(design, rig.gears, sample_time=scenario.sample_time, **scenario.controller)

    pushes, loss = scenario.pushes(), scenario.drive_loss
    wanted = scenario.wanted(np.arange(pushes.size, dtype=np.float64) * scenario.sample_time)
    first, loops = controller(), 1 + (loss is not None) + scenario.compare_single_drive
    done = Parts(loops * pushes.size, tell).done
    result = closed_loop(first, rig, scenario.wanted, scenario.duration, seed, disturbance=pushes, after_sample=done)
    single = intact = None
    if loss is not None:
        intact = result
        result = loop_with_drive_loss(
            controller(),
            rig,
            wanted,
            pushes,
            drive=loss.drive,
            time=loss.time,
            detection=loss.detection,
            seed=seed,
            after_sample=done,
        )
    if scenario.compare_single_drive:
        single = loop_with_drive_loss(
            controller(), rig, wanted, pushes, drive=2, time=0.0, seed=seed, after_sample=done
        )
    if not np.all(np.isfinite(result.angle)):
        raise BadParameter(f"{scenario.name}: the rig ran away; give the controller a model that fits the rig.")
    return Trial(
        title=scenario.title,
        scenario=scenario,
        result=result,
        min_torque=first.min_torque,
        max_torque=first.max_torque,
        single=single,
        intact=intact,
    )


def rigid_model(rig: Rig) -> ServoModel:
    """Eq. (4) with the rig's own numbers, rotors in mesh: what a careful engineer knows from the drawings."""
    motors = float(np.sum(rig.motor_viscous * rig.motor_ratios**2))
    return ServoModel(inertia=rig.total_inertia, gravity=rig.gravity, viscous_friction=rig.viscous_friction + motors)
