"""The whole chain on a synthetic log: record on the rig, identify, diagnose, extend, design, close both loops."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from allocation import Bounds, least_effort
from antidrive.closed_loop_run import ClosedLoopRun
from antidrive.scenario import Scenario
from antidrive.simulation import REPETITIONS, run_scenario
from diagnosis.diagnose import diagnose
from diagnosis.diagnosis import Diagnosis
from diagnosis.explanation.summary import headline
from diagnosis.explanation.wording import measured, percent, sentence_case, size, title_of
from diagnosis.holdout import gain_errors
from identification.log import Log
from plant.model_file import ModelFile
from plant.rig import Rig
from plant.signals import chirp, steps

SAMPLE_TIME = 0.005
HIDDEN = {"coulomb_friction": 0.25, "cogging_amplitude": 0.2, "cogging_order": 12.0, "cogging_phase": 0.7}
"""Effects of the demo's rig that its base model lacks."""
ENCODER_NOISE = 1e-4
"""Of the demo's rig [rad], two counts. With noise well below one count, mesh compliance and quantisation exceed it.
Neither is in the catalogue, and friction would then be reported as a similar effect.
"""
_LIMITS = {"min_torque": 0.02, "max_torque": 0.3}
_MOTION = Scenario(
    name="demo",
    title="Tracking",
    duration=8.0,
    sample_time=SAMPLE_TIME,
    reference={"kind": "sine", "amplitude": 0.5, "frequency": 0.15},
    rig={**HIDDEN, "encoder_noise": ENCODER_NOISE, "inertia": Rig.paper_like().inertia},
    controller={**_LIMITS, "encoder_noise": ENCODER_NOISE},
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Demo:
    """Results of the chain.

    Attributes:
        log, validation: synthetic, for identification and for validation.
        diagnosis: of that log.
        base: closed loop with the fitted base model.
        extended: the same with the extended model.
    """

    log: Log
    validation: Log
    diagnosis: Diagnosis
    base: ClosedLoopRun
    extended: ClosedLoopRun

    @property
    def trials(self) -> tuple[ClosedLoopRun, ClosedLoopRun]:
        """Both closed loops."""
        return self.base, self.extended

    @property
    def base_model(self) -> ModelFile:
        """The fitted base model."""
        return self.diagnosis.base.model_file()

    @property
    def model(self) -> ModelFile:
        """The extended model."""
        return self.diagnosis.extended.model_file()

    def summary(self) -> dict[str, Any]:
        """The missing effects, and the improvement by including them, in numbers."""
        gain = self.diagnosis.gain
        before, after = self.base.result.tracking_rms, self.extended.result.tracking_rms
        return {
            "schema": 1,
            "synthetic": True,
            "hidden": dict(HIDDEN),
            "encoder_noise": ENCODER_NOISE,
            "verdict": self.diagnosis.verdict,
            "missing": [cause.effect for cause in self.diagnosis.causes],
            "prediction": None
            if gain is None
            else {"rms_before": gain.held_out_rms_before, "rms_after": gain.held_out_rms_after, "cut": gain.cut},
            "tracking": {"rms_before": before, "rms_after": after, "cut": 1.0 - after / before},
            "least_preload_margin": self.extended.result.minimum_contact_torque,
        }

    def sentences(self) -> list[str]:
        """The summary in sentences."""
        found, gain = self.summary(), self.diagnosis.gain
        lines = [f"Synthetic log from the test-bench simulation. {headline(self.diagnosis)}"]
        for cause in self.diagnosis.causes:
            found_size = size(cause.parameters.items())
            lines.append(f"Missing: {title_of(cause.effect)}, probability {percent(cause.probability)} ({found_size}).")
        if gain is not None:
            error = gain_errors(self.diagnosis)
            was = measured(gain.held_out_rms_before, error.before, gain.unit)
            now = measured(gain.held_out_rms_after, error.after, gain.unit)
            change = _change(gain.cut, error.cut)
            lines.append(f"Prediction: validation error {was} -> {now} rms ({change}).")
        (before, first), (after, last) = (_tracking(trial) for trial in self.trials)
        change = _change(1.0 - after / before, after / before * np.hypot(first / before, last / after))
        from_to = f"{measured(before, first, 'rad')} -> {measured(after, last, 'rad')}"
        lines.append(f"Tracking: error on the test bench {from_to} rms ({change}).")
        margin = found["least_preload_margin"]
        held = "contact was never lost" if margin > 0.0 else "contact was lost"
        least = dict(self.extended.numbers())["least_preload_margin"]
        lines.append(f"Preload: minimum contact torque {least} at the output gear; {held}.")
        return lines


def run_demo(*, seed: int = 0, progress: Callable[[str], None] | None = None) -> Demo:
    """Run the chain: a log and a validation log on the rig, the diagnosis, and two controllers on the same motion.

    Args:
        seed: of the encoder's noise.
        progress: called with a line of text at each stage.
    """
    tell = progress or (lambda line: None)
    rig = _MOTION.machine()
    tell("recording a synthetic log on the test bench")
    estimation, holdout = record(rig, seed=seed), record(rig, seed=seed + 1, held_out=True)
    found = diagnose(estimation, holdout=holdout, progress=progress)
    trials = []
    for name, fit in (("base", found.base), ("extended", found.extended)):
        tell(f"closing the loop with the {name} model")
        trial = run_scenario(_MOTION, model=fit.model, seed=seed, repetitions=REPETITIONS)
        trials.append(replace(trial, title=f"{sentence_case(name)} model in closed loop on the test bench"))
    return Demo(log=estimation, validation=holdout, diagnosis=found, base=trials[0], extended=trials[1])


def record(rig: Rig, *, seed: int, held_out: bool = False) -> Log:
    """A log of the rig under a chirp and steps; the minimum preload keeps the teeth in contact."""
    if held_out:
        torque = np.concatenate(
            (
                steps(levels=(1.5, -1.2, 1.0, -2.0, 2.0, -0.8), hold=1.5, sample_time=SAMPLE_TIME),
                chirp(amplitude=1.8, start=0.1, stop=1.5, duration=9.0, sample_time=SAMPLE_TIME),
            )
        )
    else:
        torque = np.concatenate(
            (
                chirp(amplitude=2.0, start=0.05, stop=1.0, duration=14.0, sample_time=SAMPLE_TIME),
                steps(levels=(1.2, -1.4, 2.0, -1.8, 0.9, -1.0, 0.0), hold=2.0, sample_time=SAMPLE_TIME),
            )
        )
    bounds = Bounds(gears=rig.gears, **_LIMITS)
    played = rig.run(least_effort(bounds, torque), SAMPLE_TIME, seed)
    label = "synthetic held-out log" if held_out else "synthetic log"
    return Log.from_arrays(label=label, time=played.time, torque=torque, angle=played.angle)


def write_log(log: Log, path: Path) -> None:
    """Write a log in the form of a measured file: time, torque, angle."""
    import pandas as pd

    columns = [{"time": run.time, "torque": run.command, "angle": run.output} for run in log.runs]
    pd.concat(map(pd.DataFrame, columns)).to_csv(path, index=False, float_format="%.10g")


def _tracking(trial: ClosedLoopRun) -> tuple[float, float]:
    """Root mean square of the tracking error of a trial, and its standard deviation over its runs [rad]."""
    return trial.result.tracking_rms, trial.scatter()["tracking_rms"]


def _change(cut: float, std: float) -> str:
    return f"{percent(abs(cut), std)} {'less' if cut >= 0.0 else 'more'}"
