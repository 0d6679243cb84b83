"""Soft limits of angle and speed: the permitted intervals over the horizon, and the penalty for leaving them."""

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
"""Length of `SoftLimits.numbers`."""

_DEARER = 10.0
"""Factor of the penalty over the largest multiplier of the program with hard limits."""

_SHOWS = 10.0
"""A limit is reported as violated from this number of standard deviations of the sensor on."""

_CALM = 0.25
"""Share of the reported speed excess at which a load may still cross a limit, so that noise of its speed does not act
on the torques there: it overshoots by about a standard deviation of the sensor."""


@dataclass(frozen=True, kw_only=True)
class SoftLimits:
    """Limits that hold whenever the torques can make them hold.

    Attributes:
        angle: lowest and highest angle of the load [rad].
        speed: greatest speed of the load [rad/s], in both directions.
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
        """Whether there is any limit."""
        return bool(np.isfinite([*self.angle, self.speed]).any())

    def numbers(self, wave: float, sample_time: float, noise: float) -> Array:
        """(8,) limits, decay factor of an excess per sample, rate w [1/s], reported excess of angle and speed, inf.

        Args:
            wave: w, 2 pi times the bandwidth of the loop.
            sample_time: [s].
            noise: standard deviation of the sensor [rad].
        """
        shows = _SHOWS * noise
        return np.array([*self.angle, self.speed, np.exp(-wave * sample_time), wave, shows, shows * wave, np.inf])


def moved(inertia: float, sample_time: float) -> Array:
    """(4,) effect of 1 N m during a sample on each constrained quantity: torque, its change, angle and speed."""
    return np.array([1.0, 1.0, sample_time**2 / (2 * inertia), sample_time / inertia])


def prices(rate_weight: float, greatest: float, inertia: float, sample_time: float) -> Array:
    """(4,) penalty for leaving an interval by 1 N m, 1 rad or 1 rad/s; infinite (hard) for torque and its change.

    A penalty linear in the violation is exact if its weight is above every multiplier of the program with hard limits
    (Kerrigan and Maciejowski, "Soft constraints and exact penalty functions in model predictive control", 2000). A
    change of torque holds the load at a limit. The most expensive one is over the whole torque range, 2 tau, in the
    first sample, and moves the angle by 2 tau m: its cost is w (2 tau) per newton metre, w (2 tau)/m per radian. The
    penalty is ten times that.
    """
    angle, speed = _DEARER * 2 * greatest * rate_weight / moved(inertia, sample_time)[2:]
    return np.array([np.inf, np.inf, angle, speed])


@cache
def enter() -> Any:
    """The present excess over the limits, as a `casadi.Function`.

    (angle and speed (2,), limits) -> memory (8,) for `corridor`: time, remaining share of the excess, and for the upper
    and the lower limits the excess of the angle, its rate term and the excess of the speed.
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
    """The permitted intervals at the next sample, as a `casadi.Function`.

    (memory (8,), governed angle at this sample and the next two (3,), limits, sample time) -> memory, lowest and
    highest angle, least and greatest speed (4,) at the next sample. A present excess decays as
    (x + (x' + w x) t) e^(-w t), critically damped at the rate of the loop: an immediate return would pass noise to the
    torques. Where the governed reference itself is still returning to a limit, that limit is not enforced.
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
