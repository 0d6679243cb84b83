"""The kinds of experiment, by the `kind` in a scenario file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from antidrive.experiments import (
    camera_report,
    camera_tracking,
    chirp_response,
    dead_zone_curve,
    differential,
    differential_report,
    drive_losses,
    dwell_report,
    gear_train,
    preload_sizing,
    preload_sizing_report,
    reversal_dwell,
    three_steps,
)
from antidrive.experiments.outcome import Outcome


@dataclass(frozen=True)
class Kind:
    """Class of the settings, and the function that runs them with a seed; a long one also takes a progress callback.

    An experiment that depends on noise is repeated `again` times with other seeds, unless it reports its own
    uncertainty.
    """

    settings: type[Any]
    run: Callable[..., Outcome]
    long: bool = False
    again: int = 0


KINDS: Final = {
    "gear_train": Kind(gear_train.GearTrainSettings, gear_train.run),
    "three_steps": Kind(three_steps.ThreeStepsSettings, three_steps.run),
    "chirp_response": Kind(chirp_response.ChirpSettings, chirp_response.run, again=3),
    "dead_zone_curve": Kind(dead_zone_curve.DeadZoneSettings, dead_zone_curve.run, again=5),
    "drive_losses": Kind(drive_losses.LossSettings, drive_losses.run, long=True),
    "camera_tracking": Kind(camera_tracking.CameraSettings, camera_report.run, long=True),
    "differential": Kind(differential.DifferentialSettings, differential_report.run, long=True),
    "preload_sizing": Kind(preload_sizing.SizingSettings, preload_sizing_report.run, long=True),
    "reversal_dwell": Kind(reversal_dwell.DwellSettings, dwell_report.run, long=True),
}
