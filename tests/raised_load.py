"""A load of 0.4 kg m^2 that hangs and is swung up and back by rotors of 0.15 kg m^2 each, seen from the load."""

from __future__ import annotations

from functools import partial

import numpy as np
from four_hertz import four_hertz
from numpy.typing import NDArray

from allocation import Allocator
from plant import GearTrain, Rig, ServoModel

Array = NDArray[np.float64]

GEARS = GearTrain.paper()
MESH = 161 / 20
ROTOR = 0.15
MOTOR = ROTOR / GEARS.ratio**2
RIG = Rig(gears=GEARS, inertia=0.4, gravity=12.0, viscous_friction=0.2, rotor_inertia=MOTOR)
MODEL = ServoModel(inertia=RIG.total_inertia, gravity=12.0, viscous_friction=0.2)
LEAST, MOST = 0.2, 2.5
LIMITS = Allocator(GEARS, min_torque=LEAST, max_torque=MOST, rotor_inertia=MOTOR)
BY_FLANK = partial(four_hertz, MODEL, GEARS, min_torque=LEAST, max_torque=MOST, rotor_inertia=MOTOR)
BY_MOTOR = partial(four_hertz, MODEL, GEARS, min_torque=LEAST, max_torque=MOST)


def swing(acceleration: float, duration: float) -> Array:
    """Samples at 5 ms, up to the horizontal and back, with that greatest acceleration [rad/s^2]."""
    time = np.arange(0.0, duration + 0.5, 0.005)
    amplitude = np.pi / 4
    return np.asarray(
        -np.pi / 2 + amplitude * (1 - np.cos(np.sqrt(acceleration / amplitude) * np.maximum(time - 0.1, 0.0)))
    )
