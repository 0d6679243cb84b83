"""The axes of `friction_axes.py`: machines with friction on the rig, what they are told to do, and how it is scored."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpc import closed_loop
from plant import GearTrain, Rig, ServoModel
from plant.effects import CoulombFriction, Effect, StribeckFriction

Array = NDArray[np.float64]
GEARS = GearTrain(pinion_teeth=(20, 20), follower_teeth=161)
MIN_TORQUE, MAX_TORQUE = 0.02, 0.3
GREATEST = 161 / 20 * (MAX_TORQUE - MIN_TORQUE)  # at the load [N m]
INERTIAS, SAMPLE_TIMES, BITS = (0.02, 0.2, 2.0), (0.001, 0.002, 0.005), (13, 17, 20)
SHARES = (0.05, 0.2, 0.5)  # breakaway in units of the greatest torque
KINDS = ("coulomb", "stribeck")
STEP, DWELL = 0.01, 0.8  # of the small steps [rad], [s]


@dataclass(frozen=True, kw_only=True)
class Axis:
    """A load with friction behind the final mesh, and how often it is seen and told.

    Attributes:
        inertia: of the load [kg m^2].
        sample_time: [s].
        kind: "coulomb", or "stribeck": sliding takes 0.55 of what breaking away takes.
        share: breakaway torque in units of the greatest torque.
        bits: of the encoder.
    """

    inertia: float
    sample_time: float
    kind: str
    share: float
    bits: int = 17

    @property
    def _levels(self) -> tuple[float, float]:
        """Sliding friction and what breakaway has above it [N m]."""
        top = self.share * GREATEST
        return (top, 0.0) if self.kind == "coulomb" else (0.55 * top, 0.45 * top)

    def rig(self) -> Rig:
        """The machine."""
        sliding, excess = self._levels
        return Rig(
            gears=GEARS,
            inertia=self.inertia,
            gravity=0.1,
            viscous_friction=0.02,
            coulomb_friction=sliding,
            breakaway_excess=excess,
            flank_stiffness=5e3,
            flank_damping=1.0,
            encoder_counts=2**self.bits,
            encoder_noise=2e-6,
            fine_step=25e-6,
        )

    def model(self, factor: float | None) -> ServoModel:
        """What the controller is told: friction times a factor, or none."""
        sliding, excess = self._levels
        effect: Effect = CoulombFriction(torque=(factor or 0.0) * sliding)
        if self.kind == "stribeck":
            effect = StribeckFriction(coulomb=(factor or 0) * sliding, excess=(factor or 0) * excess, velocity=0.05)
        effects = () if factor is None else (effect,)
        return ServoModel(inertia=self.rig().total_inertia, gravity=0.1, viscous_friction=0.02, effects=effects)

    @property
    def options(self) -> dict[str, Any]:
        """What a controller of this axis is told besides."""
        return {
            "sample_time": self.sample_time,
            "min_torque": MIN_TORQUE,
            "max_torque": MAX_TORQUE,
            "encoder_resolution": 2 * np.pi / 2**self.bits,
            "encoder_noise": 2e-6,
            "motor_friction": 5e-4,
            "rotor_inertia": 4e-6,
        }

    def __str__(self) -> str:
        return (
            f"J {self.inertia:4g}  Ts {1e3 * self.sample_time:1.0f}  {self.kind:8}  {self.share:4.2f}  {self.bits} bit"
        )


@dataclass(frozen=True, kw_only=True)
class Task:
    """What the load is to do.

    Attributes:
        reference: wanted angle over time.
        duration: [s].
        counts: (M,) times to which of them count.
        push: torque on the load over time, in units of what makes it move.
    """

    reference: Callable[[Array], Array]
    duration: float
    counts: Callable[[Array], NDArray[np.bool_]]
    push: Callable[[Array], Array] = np.zeros_like


TASKS = {
    "sine": Task(reference=lambda t: 0.04 * (1 - np.cos(np.pi * t)), duration=4.0, counts=lambda t: t > 0.25),
    "ramp": Task(reference=lambda t: 0.01 * np.maximum(t - 0.2, 0.0), duration=2.5, counts=lambda t: t > 0.7),
    "steps": Task(
        reference=lambda t: STEP * (np.floor(t / DWELL) % 2),
        duration=4 * DWELL,
        counts=lambda t: (t > DWELL) & (t % DWELL > 0.3),
    ),
    "hold": Task(
        reference=lambda t: np.full_like(t, 0.3),
        duration=2.0,
        counts=lambda t: t > 0.5,
        push=lambda t: 1.0 * (t > 0.5),
    ),
}


@dataclass(frozen=True, kw_only=True)
class Score:
    """What a loop was worth.

    Attributes:
        rms: of the true angle less the wanted one [rad].
        flank: least flank torque [N m].
        chatter: standard deviation of the torque's change from sample to sample [N m].
        degraded: share of the samples whose status was not "optimal".
    """

    rms: float
    flank: float
    chatter: float
    degraded: float


def score(axis: Axis, controller: Any, task: Task, seed: int) -> Score:
    """Close the loop around anything that steps as a `Controller` does."""
    time = np.arange(round(task.duration / axis.sample_time)) * axis.sample_time
    moving = (axis.share + 0.1) * GREATEST
    loop = closed_loop(
        controller, axis.rig(), task.reference, task.duration, seed, disturbance=moving * task.push(time)
    )
    counts = task.counts(loop.time)
    torque = GEARS.follower_torque(loop.torques)
    return Score(
        rms=float(np.sqrt(np.mean((loop.angle - loop.reference)[counts] ** 2))),
        flank=loop.least_flank_torque,
        chatter=float(np.std(np.diff(torque)[counts[1:]])),
        degraded=loop.degraded / loop.time.size,
    )
