"""Other controllers on the axes of `friction_axes.py`: a cascade of P and PI, and PD with a disturbance observer.

Both follow the reference of our governor, use the same torque allocation, and have feed-forward of velocity,
acceleration, gravity and friction of the model. Their feedback is a linear controller on the error, tuned by a search.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import control
import numpy as np
from friction_machines import GEARS, GREATEST, MAX_TORQUE, MIN_TORQUE, Axis
from numpy.typing import NDArray

from allocation import Bounds, least_effort
from mpc import Control
from mpc.governor import Governor
from plant import ServoModel
from plant.effects import Moment

Array = NDArray[np.float64]
BOUNDS = Bounds(gears=GEARS, min_torque=MIN_TORQUE, max_torque=MAX_TORQUE, rotor_inertia=4e-6, motor_friction=5e-4)
FLOOR = MIN_TORQUE * 161 / 20  # minimum flank torque: limit on the change of the friction feed-forward per sample [N m]
PEAK, CHATTER = 2.0, 0.125 * FLOOR
"""Limits of the search, as in `mpc.tuning`: peak sensitivity, and change of the torque due to encoder noise."""


@dataclass(eq=False)
class Peer:
    """Feed-forward and a linear feedback on the error.

    Attributes:
        axis: machine to control.
        model: model of the machine.
        feedback: (error [rad]) -> torque [N m], discrete.
    """

    axis: Axis
    model: ServoModel
    feedback: Any
    horizon: int = 2
    motor_resolution: None = None
    bounds: Bounds = BOUNDS
    _state: Array = field(init=False)

    def __post_init__(self) -> None:
        self.sample_time, K = self.axis.sample_time, self.feedback
        self._K = (np.array(K.A), np.array(K.B)[:, 0], np.array(K.C)[0], float(K.D.item()))
        self._reach = self.bounds.reachable()
        forward, _ = self._friction(0.0, 1.0)
        limit = max(0.85 * (GREATEST - forward), 0.1 * GREATEST) / self.model.inertia
        jerk = FLOOR / (4 * self.model.inertia * self.sample_time)
        self._limits, self._governor = (limit, limit), Governor(sample_time=self.sample_time, jerk=jerk)
        self.reset()

    def reset(self) -> None:
        """Reset the state."""
        self._state = np.zeros(self.feedback.nstates)
        self._governor.path[:] = 0.0
        self._last_speed = self._rubs = 0.0

    def _friction(self, angle: float, velocity: float) -> tuple[float, float]:
        at = Moment(angle=angle, velocity=velocity, inertia=self.model.inertia)
        forward, backward = self.model.dry_friction(at) or (0.0, 0.0)
        return float(forward), float(backward)

    def step(self, angle: float, reference: Array, motors: object = None) -> Control:
        """From the measured angle to the pinion torques."""
        references = np.broadcast_to(np.asarray(reference, dtype=np.float64), (self.horizon + 1,))
        path, dt = self._governor.govern(references, self._limits), self.sample_time
        speed, later = (path[1] - path[0]) / dt, (path[2] - path[1]) / dt
        forward, backward = self._friction(path[0], speed)
        wanted = forward if speed > 1e-4 else -backward if speed < -1e-4 else 0.0
        rubs = self._rubs = float(np.clip(wanted, self._rubs - FLOOR, self._rubs + FLOOR))
        model = self.model
        ahead = model.inertia * (later - self._last_speed) / (2 * dt) + model.viscous_friction * speed
        ahead += model.gravity * float(np.cos(path[0])) + rubs
        self._last_speed = speed
        error, (A, B, C, D), (low, high) = path[0] - angle, self._K, self._reach
        torque = ahead + float(C @ self._state + D * error)
        if low < torque < high:  # otherwise the state is frozen (anti-windup)
            self._state = A @ self._state + B * error
        torques = least_effort(self.bounds, float(np.clip(torque, low, high)))
        return Control(np.array([0.0, 0.0, 0.0, *torques, *path[:2]]))


def cascade(J: float, w: float, dt: float, integral: float) -> Any:
    """P on the angle, PI on a filtered velocity: (kp e + v) (kv + ki/s), v by a first-order filter of 5 w."""
    s = control.tf("s")
    velocity = s / (1 + s / (5 * w))
    continuous = J * w * (1 + integral * w / s) * (w / 3 + velocity)
    return control.c2d(control.ss(continuous), dt, "tustin")


def observed(J: float, w: float, dt: float, faster: float) -> Any:
    """PD with a disturbance observer: three observer poles at `faster` w, two poles of the law at w."""
    A = np.array([[1, dt, dt**2 / 2 / J], [0, 1, dt / J], [0, 0, 1.0]])  # error, its rate, disturbance torque
    B = np.array([[-(dt**2) / 2 / J], [-dt / J], [0.0]])
    row = np.array([[1.0, 0.0, 0.0]])
    pole = np.exp(-faster * w * dt)
    gain = np.asarray(control.acker(A.T, (row @ A).T, [pole, pole, pole])).reshape(3, 1)  # of the corrected estimate
    law = np.array([[J * w**2, 2 * J * w, 1.0]])
    keep = np.eye(3) - gain @ row
    state = keep @ (A + B @ law)  # x = keep (A + B law) x_before + gain e, torque = law x
    return control.ss(state, gain, law @ state, law @ gain, dt)


def admitted(axis: Axis, J: float, feedback: Any) -> bool:
    """Whether margin and chatter of a loop are within the limits."""
    dt = axis.sample_time
    plant = control.c2d(control.ss([[0, 1], [0, 0]], [[0], [1 / J]], [[1, 0]], 0), dt)
    frequencies = np.concatenate((np.geomspace(1e-4, 0.05, 200), np.linspace(0.05, 0.5, 200)))
    z = np.exp(2j * np.pi * frequencies)
    K, P = np.asarray(feedback(z)), np.asarray(plant(z))
    S = 1 / (1 + K * P)
    closed = control.feedback(plant * feedback, 1)
    if np.max(np.abs(closed.poles())) >= 1 or np.max(np.abs(S)) > PEAK:
        return False
    noise = np.hypot(2 * np.pi / 2**axis.bits / np.sqrt(12), 2e-6)
    change = np.abs(K * S * (z - 1)) ** 2
    return bool(noise * np.sqrt(2 * np.trapezoid(change, frequencies)) <= CHATTER)


def candidates(axis: Axis, J: float, kind: str) -> Iterator[Any]:
    """Feedbacks of two shapes: the fastest that is within the limits, and a slower one."""
    make, shapes = (cascade, (0.1, 0.25)) if kind == "cascade" else (observed, (2.0, 4.0))
    for shape in shapes:
        low, high = 1e-3 * np.pi / axis.sample_time, np.pi / axis.sample_time
        for _ in range(12):
            middle = float(np.sqrt(low * high))
            good = admitted(axis, J, make(J, middle, axis.sample_time, shape))
            low, high = (middle, high) if good else (low, middle)
        for share in (1.0, 0.6):
            yield make(J, share * low, axis.sample_time, shape)
