"""The controller in closed loop on the machine that hides effects, which gets the output torque of its pinions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from four_hertz import four_hertz
from machine import Array, Machine, record

from mpc import Controller
from plant import GearTrain, ServoModel

GEARS = GearTrain.paper()
MAX_TORQUE = 1.0  # of a pinion [N m]: 7.9 N m on the output gear, the range of the torques in the logs
NOISE = 1e-3  # of the angle [rad], as in the logs
SETTLED = 1.0  # from then on errors count [s]: what every model must learn at first is over


def swing(time: Array) -> Array:
    """To and fro within 1.2 rad at a quarter hertz [rad]: up to 4 N m, 0.9 rad/s and a reversal every 2 s."""
    return 0.6 * (1 - np.cos(2 * np.pi * 0.25 * time))


def goes_on(controller: Controller) -> Array:
    """(20, 2) pinion torques of the next steps [N m]; here, so that other processes find it."""
    return np.array([controller.step(0.01 + 1e-4 * k, 0.1).torques for k in range(20)])


@dataclass(frozen=True, kw_only=True, eq=False)
class Pinions:
    """A controller that follows a reference; it notes its pinion torques, (2,) each [N m], and statuses."""

    controller: Controller
    wanted: Array  # (T + N,) [rad]
    torques: list[Array] = field(default_factory=list)
    statuses: list[str] = field(default_factory=list)

    @property
    def reference(self) -> Array:
        return self.wanted[: -self.controller.horizon]

    def torque(self, measured: Array, sample_time: float) -> Array:
        now = measured.shape[0] - 1
        control = self.controller.step(measured[-1, 0], self.wanted[now : now + self.controller.horizon + 1])
        self.torques.append(control.torques)
        self.statuses.append(control.status)
        return GEARS.output_torque(control.torques)


@dataclass(frozen=True, kw_only=True)
class Tracking:
    """One closed loop: rms and largest error [rad], mean of xi1^2 + xi2^2 [N^2 m^2], samples that were not optimal."""

    rms: float
    worst: float
    copper_loss: float
    degraded: int


def track(
    machine: Machine,
    model: ServoModel,
    reference: Callable[[Array], Array],
    duration: float,
    *,
    seed: int = 0,
    begin: float = 60.0,
    noise: float = NOISE,
    **options: Any,
) -> Tracking:
    """A controller of the model follows a reference on the machine, whose clock shows `begin` [s] at the start."""
    controller = four_hertz(model, GEARS, max_torque=MAX_TORQUE, encoder_noise=noise, **options)
    dt = controller.sample_time
    wanted = reference(np.arange(round(duration / dt) + controller.horizon) * dt)
    loop = Pinions(controller=controller, wanted=wanted)
    out = record(machine, loop, seed=seed, sample_time=dt, angle=wanted[0], begin=begin, noise=noise)
    settled = round(SETTLED / dt)
    error = (out.angle[:, 0] - loop.reference)[settled:]
    return Tracking(
        rms=float(np.sqrt(np.mean(error**2))),
        worst=float(np.max(np.abs(error))),
        copper_loss=float(np.mean(np.sum(np.square(loop.torques[settled:]), axis=1))),
        degraded=sum(status != "optimal" for status in loop.statuses),
    )
