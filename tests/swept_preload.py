"""Sweeps of the preload in pure arithmetic: no rig, no dynamics, the law of the teeth alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identification.log import Log, Run
from plant.gears import GearTrain

Array = NDArray[np.float64]
GEARS = GearTrain.paper()
ARCMIN = np.pi / 180 / 60


@dataclass(frozen=True, kw_only=True)
class Teeth:
    """Two drives: gaps [rad], stiffness [N m/rad], friction [N m] and its share of the torque; encoders."""

    gaps: tuple[float, float] = (0.5 * ARCMIN, 2 * ARCMIN)
    stiffness: tuple[float, float] = (2e4, 1.5e4)
    friction: tuple[float, float] = (0.05, 0.08)
    coefficient: tuple[float, float] = (0.05, 0.02)
    bits: int = 17
    motor_bits: int = 17
    noise: float = 5e-6


def swept(teeth: Teeth, seed: int, *, visits: int = 8, length: int = 500, load_speed: float = 2e-7) -> Log:
    """A log of visits of both flanks; the load moves some [rad] a sample from a random place in its count."""
    rng = np.random.default_rng(seed)
    part = (np.arange(length) + 1.0) / length
    size = np.tile(0.5 + 7.5 * (1.0 - np.abs(2.0 * part - 1.0)), visits)
    commanded = np.repeat(np.where(np.arange(visits) % 2, -1.0, 1.0), length) * size
    acts = 0.5 * (commanded + np.concatenate((commanded[:1], commanded[:-1])))
    grows = np.tile(np.where(part <= 0.5 + 0.5 / length, 1.0, -1.0), visits)
    load = rng.uniform(0.0, 1.0) * 1e-3 + load_speed * np.arange(commanded.size)
    count, turn = 2 * np.pi / 2**teeth.bits, 2 * np.pi / 2**teeth.motor_bits
    rotors = []
    for drive, sense in enumerate((-1.0, 1.0)):
        friction, mu = teeth.friction[drive], teeth.coefficient[drive]
        passed = (np.abs(acts) - grows * friction) / (1.0 + grows * mu)
        twist = np.sign(sense * acts) * (0.5 * teeth.gaps[drive] + passed / teeth.stiffness[drive])
        rotors.append(load + 0.3 * drive + twist)
    shafts = np.column_stack(rotors) * GEARS.pre_reduction * GEARS.angle_map
    pinions = np.column_stack((-commanded, commanded)) / GEARS.torque_map
    reading = np.round((load + teeth.noise * rng.standard_normal(load.size)) / count) * count
    run = Run(
        label="sweep",
        number=0,
        time=np.arange(commanded.size) * 1e-3,
        command=GEARS.output_torque(pinions),
        output=reading,
        valid=np.ones(commanded.size, dtype=bool),
        servo_gain=np.zeros(commanded.size),
        drive_angles=np.round(shafts / turn) * turn,
        torques=pinions,
    )
    return Log(runs=(run,), axis="rotary")
