"""BAM raw logs: a Dynamixel XL330 position servo that swings a mass.

Duclusaud et al.: Extended Friction Models for the Physics Simulation of Servo Actuators. ICRA 2025. One JSON file a
run; the firmware's law is duty = kp * 4096 / (2 pi) / (256 * 885) * (goal - angle).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from identification.datasets.dataset import Dataset, source
from identification.datasets.pendulum import ENDS_WHEN_OFF, VOLTS_UNKNOWN_SCALE, swing
from identification.errors import MalformedLog
from identification.log import Log
from identification.recording import Recording
from plant.servo import ServoModel

_DUTY_PER_RAD = 4096.0 / (2.0 * np.pi) / (256.0 * 885.0)  # for each unit of kp
_NOTES = (
    "BAM (Duclusaud et al. 2025), Dynamixel XL330: every fourth file is held out, the others are fitted.",
    VOLTS_UNKNOWN_SCALE,
    ENDS_WHEN_OFF,
)


def read(files: list[Path]) -> Dataset:
    """Read all runs; every fourth file in the order of the names is held out."""
    if len(files) < 2:
        raise MalformedLog("BAM's logs are one file a run; give at least two, one of them is held out.")
    runs = [_recording(file, number) for number, file in enumerate(files)]
    logs = []
    for held in (False, True):
        places = [place for place in range(len(files)) if (place % 4 == 3 or (len(files) < 4 and place == 1)) is held]
        sources = [source(files[place]) for place in places]
        logs.append(
            Log.from_recordings([runs[p] for p in places], axis="rotary", sources=sources, command_unit="V")
        )
    base = ServoModel(inertia=0.02, gravity=1.0, viscous_friction=0.5)
    return Dataset(estimation=logs[0], holdout=logs[1], base=base, notes=_NOTES)


def _recording(file: Path, number: int) -> Recording:
    try:
        content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        entries = content["entries"]

        def channel(name: str) -> np.ndarray:
            return np.array([entry[name] for entry in entries], dtype=float)

        return swing(
            label=f"{file.stem} {content['trajectory']} kp {content['kp']}",
            number=number,
            time=channel("timestamp"),
            goal=channel("goal_position"),
            position=channel("position"),
            duty_per_rad=_DUTY_PER_RAD * float(content["kp"]),
            volts=channel("input_volts"),
            enabled=channel("torque_enable") > 0.5,
        )
    except (OSError, ValueError, KeyError, TypeError, IndexError) as error:
        raise MalformedLog(f"{file.name} is not a log of BAM ({type(error).__name__}: {error}).") from None
