"""Soft limits of angle and speed: the corridor that the horizon has, and what it costs to leave it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from plant.errors import BadParameter

Array = NDArray[np.float64]

SOFT = 8
"""Numbers of the limits, see `SoftLimits.numbers`."""

_DEARER = 10.0
"""By how much leaving the corridor costs more than what it could spare."""

_SHOWS = 10.0
"""A limit is reported as broken from so many standard deviations of the sensor on."""

_CALM = 0.25
"""Share of that at which a load may pass a limit, so that noise in its speed does not shake the torques there: by a
standard deviation of the sensor."""


@dataclass(frozen=True, kw_only=True)
class SoftLimits:
    """Limits that are kept wherever the torques can keep them.

    Attributes:
        angle: lowest and highest angle of the load [rad].
        speed: greatest speed of the load [rad/s], in either sense.
    """

    angle: tuple[float, float] = (-np.inf, np.inf)
    speed: float = np.inf

    def __post_init__(self) -> None:
        """Check the numbers."""
        pair = np.asarray(self.angle, dtype=np.float64)
        if pair.shape != (2,) or not pair[0] < pair[1]:
            raise BadParameter(f"angle_limits must be a lower and a higher angle, not {self.angle!r}.")
        if not self.speed > 0:
            raise BadParameter(f"speed_limit must be above zero, not {self.speed!r}.")

    @property
    def any(self) -> bool:
        """Whether there are limits at all."""
        return bool(np.isfinite([*self.angle, self.speed]).any())

    def numbers(self, wave: float, sample_time: float, noise: float) -> Array:
        """(8,) limits, by what share an excess fades in a sample, the loop's rate w [1/s], what counts as broken, inf.

        Args:
            wave: w, 2 pi times the bandwidth of the loop.
            sample_time: [s].
            noise: standard deviation of the sensor [rad].
        """
        shows = _SHOWS * noise
        return np.array([*self.angle, self.speed, np.exp(-wave * sample_time), wave, shows, shows * wave, np.inf])


def moved(inertia: float, sample_time: float) -> Array:
    """(4,) by how much 1 N m moves in a sample what has an interval: torque, its change, angle and speed."""
    return np.array([1.0, 1.0, sample_time**2 / (2 * inertia), sample_time / inertia])


def prices(rate_weight: float, greatest: float, inertia: float, sample_time: float) -> Array:
    """(4,) of leaving an interval by 1 N m, 1 rad or 1 rad/s; those of the torque and its change cannot be left.

    A penalty by the distance itself is exact if its price is above every multiplier of the program with hard limits
    (Kerrigan and Maciejowski, "Soft constraints and exact penalty functions in model predictive control", 2000). What
    holds a load at a limit is a change of torque. The dearest is one from end to end of the reach, 2 tau, in the first
    sample, which moves the angle by 2 tau m: it costs w (2 tau) per newton metre, w (2 tau)/m per radian. The price is
    ten times that.
    """
    angle, speed = _DEARER * 2 * greatest * rate_weight / moved(inertia, sample_time)[2:]
    return np.array([np.inf, np.inf, angle, speed])


@cache
def enter() -> Any:
    """What is beyond the limits now, as a `casadi.Function`.

    (angle and speed (2,), limits) -> memory (8,) for `corridor`: time, share that is left, and by what angle, rate of
    angle and speed the load is beyond the upper and the lower limits.
    """
    state, soft = ca.SX.sym("state", 2), ca.SX.sym("soft", SOFT)
    memory: list[Any] = [0, 1]
    for sign, angle in ((1, soft[1]), (-1, soft[0])):
        beyond = sign * (state[0] - angle)
        leaving = sign * state[1] + soft[4] * beyond
        leaving = ca.if_else(beyond > 0, leaving, ca.fmin(ca.fmax(leaving, 0), _CALM * soft[6]))
        memory += [ca.fmax(beyond, 0), leaving, ca.fmax(sign * state[1] - soft[2], 0)]
    return ca.Function("enter", [state, soft], [ca.vertcat(*memory)], {"cse": True})


@cache
def corridor() -> Any:
    """The corridor one sample on, as a `casadi.Function`.

    (memory (8,), governed angle now, next and behind that (3,), limits, sample time) -> memory, lowest and highest
    angle, least and greatest speed (4,) at the next sample. What is beyond it now fades as (x + (x' + w x) t) e^(-w t),
    critically damped, at the rate of the loop: if it had to be back at once, noise would shake the torques. Where the
    governed reference itself is still on its way back to a limit, to follow it is all that is asked.
    """
    memory, ahead = ca.SX.sym("memory", 8), ca.SX.sym("ahead", 3)
    soft, dt = ca.SX.sym("soft", SOFT), ca.SX.sym("dt")
    time, share = memory[0] + dt, memory[1] * soft[3]
    angle, pace = ahead[1], (ahead[2] - ahead[0]) / (2 * dt)
    ends = []
    for sign, limit, (beyond, leaving, faster) in (
        (1, soft[1], ca.vertsplit(memory[2:5])),
        (-1, soft[0], ca.vertsplit(memory[5:8])),
    ):
        highest = sign * limit + ca.fmax(beyond + leaving * time, 0) * share
        fastest = soft[2] + faster * share
        returning, braking = sign * (angle - limit) > soft[5], sign * pace - soft[2] > soft[6]
        ends += [sign * ca.if_else(returning, soft[7], highest), sign * ca.if_else(braking, soft[7], fastest)]
    (highest, fastest, lowest, slowest) = ends
    outputs = [ca.vertcat(time, share, memory[2:]), ca.vertcat(lowest, highest, slowest, fastest)]
    return ca.Function("corridor", [memory, ahead, soft, dt], outputs, {"cse": True})
