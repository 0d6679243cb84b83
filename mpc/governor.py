"""The reference governor: a reference that the torques can follow."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def time_optimal_acceleration(error: float, rate: float, limit: float, step: float) -> float:
    """Acceleration that brings a double integrator to rest at zero in least time, in discrete time.

    The control law of Han ("From PID to active disturbance rejection control", 2009, eq. 3): unlike the switching curve
    of continuous time it ends exactly at zero after finitely many steps and does not chatter there.

    Args:
        error, rate: position and its rate [rad], [rad/s].
        limit: greatest acceleration [rad/s^2], above zero.
        step: time step [s].
    """
    d = limit * step**2
    a0 = step * rate
    y = error + a0
    a1 = math.sqrt(d * (d + 8.0 * abs(y)))
    a = a0 + y if abs(y) <= d else a0 + math.copysign((a1 - d) / 2.0, y)
    return -limit * a / d if abs(a) <= d else -math.copysign(limit, a)


@dataclass(eq=False, kw_only=True)
class Governor:
    """Follow the wanted angle as closely as a bounded acceleration allows.

    A horizon much shorter than the time that it takes to brake cannot see that it goes too fast; with torques at
    their limits the loop then overshoots or cycles. So the controller follows a governed reference: equal to the wanted
    one as long as this can be followed, and time-optimal towards it otherwise.

    Attributes:
        sample_time: [s].
    """

    sample_time: float
    _angle: float | None = field(default=None, init=False)
    _rate: float = field(default=0.0, init=False)

    def restart(self, angle: float, rate: float) -> None:
        """Begin at an angle [rad] and speed [rad/s]."""
        self._angle, self._rate = angle, rate

    def distance(self, angle: float) -> float:
        """How far an angle is from the governed reference now [rad]; inf before the first restart."""
        return float("inf") if self._angle is None else abs(angle - self._angle)

    def govern(self, wanted: Array, limits: tuple[float, float]) -> Array:
        """The governed reference over the horizon, and one sample on.

        Args:
            wanted: (N + 1,) wanted angle from now on [rad].
            limits: greatest acceleration backward and forward [rad/s^2], both above zero.

        Returns:
            (N + 1,) governed angle from now on [rad].
        """
        dt, (backward, forward) = self.sample_time, limits
        speeds = np.append(np.diff(wanted), wanted[-1] - wanted[-2]) / dt
        accelerations = np.append(np.diff(speeds), 0.0) / dt
        angle = float(wanted[0]) if self._angle is None else self._angle
        path, rate = [(angle, self._rate)], self._rate
        for target, speed, turn in zip(*(x.tolist() for x in (wanted, speeds, accelerations)), strict=True):
            own = min(max(turn, -backward), forward)
            room = max(min(forward - own, backward + own), 0.2 * min(forward, backward))
            pull = time_optimal_acceleration(angle - target, rate - speed, room, dt)
            angle += dt * rate
            rate += dt * min(max(own + pull, -backward), forward)
            path.append((angle, rate))
        self._angle, self._rate = path[1]
        return np.array([angle for angle, _ in path[:-1]])
