"""The loop to which the figures of many tests belong: four hertz and thirty samples, with little margin."""

from __future__ import annotations

from typing import Any

from mpc import Controller
from plant import GearTrain, ServoModel

LOOP: dict[str, Any] = {"bandwidth": 4.0, "horizon": 30, "disturbance_rate": 1.0, "torque_noise": 0.05}


def four_hertz(model: ServoModel, gears: GearTrain, **options: Any) -> Controller:
    """A controller of that loop unless an option says otherwise, in place of the one that `mpc.tuning` chooses."""
    return Controller(model, gears, **{**LOOP, **options})
