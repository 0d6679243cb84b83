"""The axes of `friction_axes.py`: machines with friction on the rig, their tasks, and their scores."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpc import closed_loop
from plant import GearTrain, Rig, ServoModel
from plant.effects import (
    AsymmetricFriction,
    CoulombFriction,
    Effect,
    InputDelay,
    LoadDependentFriction,
    StribeckFriction,
)

Array = NDArray[np.float64]
GEARS = GearTrain(pinion_teeth=(20, 20), output_teeth=161)
MIN_TORQUE, MAX_TORQUE = 0.02, 0.3
GREATEST = 161 / 20 * (MAX_TORQUE - MIN_TORQUE)  # at the load [N m]
INERTIAS, SAMPLE_TIMES, BITS = (0.02, 0.2, 2.0), (0.001, 0.002, 0.005), (13, 17, 20)
SHARES = (0.05, 0.2, 0.5)  # breakaway torque in units of the greatest torque
KINDS = ("coulomb", "stribeck", "asymmetric", "motor", "load", "delay")
MOTOR_FRICTION = 5e-4  # of each motor at its shaft [N m]
DELAY = 0.004  # of the encoder of the kind "delay" [s]
FLOOR = MIN_TORQUE * 161 / 20  # minimum torque of a flank [N m]
STEP, DWELL = 0.01, 0.8  # of the small steps [rad], [s]


@dataclass(frozen=True, kw_only=True)
class Axis:
    """A load with friction at the output gear, and its measurement.

    Attributes:
        inertia: of the load [kg m^2].
        sample_time: [s].
        kind: "coulomb"; "stribeck": sliding friction is 0.55 of breakaway; "asymmetric": backward half of forward;
            "motor": friction of the motors, not of the load; "load": friction in the mesh in proportion to the
            transmitted torque, with `share` as the coefficient; "delay": Coulomb friction, and delayed measurements.
        share: breakaway torque in units of the greatest torque.
        bits: of the encoder.
    """

    inertia: float
    sample_time: float
    kind: str
    share: float
    bits: int = 17

    @property
    def _top(self) -> float:
        """Friction at breakaway [N m]."""
        return self.share * GREATEST

    def rig(self) -> Rig:
        """The machine; asymmetric friction is symmetric friction plus a constant torque."""
        top, rubs = self._top, {"motor_coulomb": MOTOR_FRICTION}
        match self.kind:
            case "stribeck":
                rubs |= {"coulomb_friction": 0.55 * top, "breakaway_excess": 0.45 * top}
            case "asymmetric":
                rubs |= {"coulomb_friction": 0.75 * top, "torque_offset": -0.25 * top}
            case "motor":
                rubs |= {"motor_coulomb": self._of_motors}
            case "load":
                rubs |= {"mesh_friction": self.share}
            case _:
                rubs |= {"coulomb_friction": top}
        return Rig(
            gears=GEARS,
            inertia=self.inertia,
            gravity=0.1,
            viscous_friction=0.02,
            flank_stiffness=5e3,
            flank_damping=1.0,
            encoder_counts=2**self.bits,
            encoder_noise=2e-6,
            encoder_delay=DELAY if self.kind == "delay" else 0.0,
            fine_step=25e-6,
            **rubs,
        )

    @property
    def _of_motors(self) -> float:
        """Friction of each motor [N m]."""
        return self._top / (2 * 161 / 20) if self.kind == "motor" else MOTOR_FRICTION

    def model(self, factor: float | None) -> ServoModel:
        """The controller's model: friction times a factor, or none; the delay is always known."""
        top, share = (factor or 0.0) * self._top, (factor or 0.0) * self.share
        known_effects: dict[str, tuple[Effect, ...]] = {
            "stribeck": (StribeckFriction(coulomb=0.55 * top, excess=0.45 * top, velocity=0.05),),
            "asymmetric": (AsymmetricFriction(forward=top, backward=0.5 * top),),
            "load": (LoadDependentFriction(coefficient=share), CoulombFriction(torque=2 * share * FLOOR)),
        }
        effects = () if factor is None else known_effects.get(self.kind, (CoulombFriction(torque=top),))
        if self.kind == "delay":
            effects = (*effects, InputDelay(time=DELAY))
        return ServoModel(inertia=self.rig().total_inertia, gravity=0.1, viscous_friction=0.02, effects=effects)

    @property
    def options(self) -> dict[str, Any]:
        """Further attributes of the controller of this axis."""
        return {
            "sample_time": self.sample_time,
            "min_torque": MIN_TORQUE,
            "max_torque": MAX_TORQUE,
            "encoder_resolution": 2 * np.pi / 2**self.bits,
            "encoder_noise": 2e-6,
            "motor_friction": self._of_motors,
            "rotor_inertia": 4e-6,
        }

    def __str__(self) -> str:
        return (
            f"J {self.inertia:4g}  Ts {1e3 * self.sample_time:1.0f}  {self.kind:10}  {self.share:4.2f}  {self.bits} bit"
        )


@dataclass(frozen=True, kw_only=True)
class Task:
    """Task of the load.

    Attributes:
        reference: reference angle over time.
        duration: [s].
        counts: (M,) times -> which of them count.
        push: torque on the load over time, in units of the torque that makes it move.
        announced: whether the reference is known ahead. With a known set-point the load would move before its time, the
            more so the less it sticks, and that would count as an error.
    """

    reference: Callable[[Array], Array]
    duration: float
    counts: Callable[[Array], NDArray[np.bool_]]
    push: Callable[[Array], Array] = np.zeros_like
    announced: bool = True


TASKS = {
    "sine": Task(reference=lambda t: 0.04 * (1 - np.cos(np.pi * t)), duration=4.0, counts=lambda t: t > 0.25),
    "ramp": Task(reference=lambda t: 0.01 * np.maximum(t - 0.2, 0.0), duration=2.5, counts=lambda t: t > 0.7),
    "steps": Task(
        reference=lambda t: STEP * (np.floor(t / DWELL) % 2),
        duration=4 * DWELL,
        counts=lambda t: (t > DWELL) & (t % DWELL > 0.3),
        announced=False,
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
    """Score of a loop.

    Attributes:
        rms: of the true angle less the reference [rad].
        flank: minimum flank torque [N m].
        chatter: standard deviation of the torque's change from sample to sample [N m].
        degraded: share of the samples whose status was not "optimal".
    """

    rms: float
    flank: float
    chatter: float
    degraded: float


class Surprised:
    """A controller that only gets the present value of the reference."""

    def __init__(self, controller: Any) -> None:
        self._controller = controller

    def __getattr__(self, name: str) -> Any:
        """All other attributes are the controller's."""
        return getattr(self._controller, name)

    def step(self, angle: float, reference: Array, motors: object = None) -> Any:
        """A step of the controller with a single number as the reference."""
        return self._controller.step(angle, float(reference[0]), motors)


def score(axis: Axis, controller: Any, task: Task, seed: int) -> Score:
    """Close the loop with any object that has the `step` of a `Controller`."""
    time = np.arange(round(task.duration / axis.sample_time)) * axis.sample_time
    moving = (axis.share + 0.1) * GREATEST
    tracked = controller if task.announced else Surprised(controller)
    loop = closed_loop(tracked, axis.rig(), task.reference, task.duration, seed, disturbance=moving * task.push(time))
    counts = task.counts(loop.time)
    torque = GEARS.output_torque(loop.torques)
    return Score(
        rms=float(np.sqrt(np.mean((loop.angle - loop.reference)[counts] ** 2))),
        flank=loop.minimum_contact_torque,
        chatter=float(np.std(np.diff(torque)[counts[1:]])),
        degraded=loop.degraded / loop.time.size,
    )
