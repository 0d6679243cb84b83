"""BAM raw logs: a Dynamixel XL330 position servo that moves a pendulum.

Duclusaud et al.: Extended Friction Models for the Physics Simulation of Servo Actuators. ICRA 2025. One JSON file per
run; the firmware's law is duty = kp * 4096 / (2 pi) / (256 * 885) * (set-point - angle). The register `load` holds the
pulse width in 1/885, and agrees with that law within 1 %.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from identification.datasets.dataset import Dataset, source
from identification.datasets.pendulum import ENDS_WHEN_OFF, VOLTS_UNKNOWN_SCALE, pendulum_run
from identification.errors import MalformedLog
from identification.log import Log
from identification.recording import Recording
from plant.servo import ServoModel

_DUTY_PER_RAD = 4096.0 / (2.0 * np.pi) / (256.0 * 885.0)  # for each unit of kp
_NOTES = (
    "BAM (Duclusaud et al. 2025), Dynamixel XL330: the runs at the highest gain are held out, the others are fitted.",
    VOLTS_UNKNOWN_SCALE,
    ENDS_WHEN_OFF,
)


def read(files: list[Path]) -> Dataset:
    """Read all runs; those at the highest gain are held out, or every fourth if all have the same gain."""
    if len(files) < 2:
        raise MalformedLog("BAM's logs are one file a run; give at least two, one of them is held out.")
    contents = [_content(file) for file in files]
    runs = [_recording(file, contents[number], number) for number, file in enumerate(files)]
    gains = [float(content["kp"]) for content in contents]
    if min(gains) < max(gains):
        held_out = [gain == max(gains) for gain in gains]
    else:
        held_out = [place % 4 == 3 or (len(files) < 4 and place == 1) for place in range(len(files))]
    logs = []
    for held in (False, True):
        places = [place for place in range(len(files)) if held_out[place] is held]
        sources = [source(files[place]) for place in places]
        logs.append(Log.from_recordings([runs[p] for p in places], axis="rotary", sources=sources, command_unit="V"))
    base = ServoModel(inertia=0.02, gravity=1.0, viscous_friction=0.5)
    return Dataset(estimation=logs[0], holdout=logs[1], base=base, notes=_NOTES)


def _content(file: Path) -> dict[str, Any]:
    try:
        content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        float(content["kp"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise _not_bam(file, error) from None
    return content


def _not_bam(file: Path, error: Exception) -> MalformedLog:
    return MalformedLog(f"{file.name} is not a log of BAM ({type(error).__name__}: {error}).")


def _recording(file: Path, content: dict[str, Any], number: int) -> Recording:
    try:
        entries = content["entries"]

        def channel(name: str) -> np.ndarray:
            return np.array([entry[name] for entry in entries], dtype=float)

        return pendulum_run(
            label=f"{file.stem} {content['trajectory']} kp {content['kp']}",
            number=number,
            time=channel("timestamp"),
            setpoint=channel("goal_position"),
            position=channel("position"),
            duty_per_rad=_DUTY_PER_RAD * float(content["kp"]),
            volts=channel("input_volts"),
            enabled=channel("torque_enable") > 0.5,
        )
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise _not_bam(file, error) from None
