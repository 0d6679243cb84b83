"""Trajectory planning from rest to rest: in minimum time, or in a given time with least copper loss."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allocation import Limits
from mpc.shooting import Shooting
from plant.effects.effect import Stage
from plant.errors import BadParameter
from plant.number import whole
from plant.result_display import Drawn
from plant.servo import ServoModel
from plant.simulation import simulate

Array = NDArray[np.float64]

_FINER = 20
"""Steps per interval of the simulation that checks a trajectory."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory(Drawn):
    """A move over N intervals with constant torques in each.

    Attributes:
        time: (N + 1,) [s], from zero.
        angle: (N + 1,) planned angle of the load [rad].
        speed: (N + 1,) planned speed of the load [rad/s].
        output_torque: (N,) of both pinions together, at the output gear [N m].
        torques: (N, 2) pinion torques [N m]; always inside the bounds.
        copper_loss: integral of xi1^2 + xi2^2 [N^2 m^2 s], proportional to the Joule heat.
        margin: smallest motor or contact torque minus the minimum [N m], seen from the pinion, in a fine simulation of
            the model with these torques and exact dry friction.
        miss: (2,) final error of that simulation in angle and velocity [rad], [rad/s].
        status: "optimal", or "failed: " and the reason; margin and miss are valid for the torques in both cases.
    """

    time: Array
    angle: Array
    speed: Array
    output_torque: Array
    torques: Array
    copper_loss: float
    margin: float
    miss: Array
    status: str

    def __repr__(self) -> str:
        """Duration, loss and status in one line."""
        return f"Trajectory({self.duration:.4g} s, copper loss {self.copper_loss:.4g} N² m² s, {self.status})"

    @property
    def duration(self) -> float:
        """Duration of the move [s]."""
        return float(self.time[-1])

    def reference(self, time: ArrayLike) -> Array:
        """Angle at given times [rad], as a reference for a controller; constant before the start and after the end."""
        from scipy.interpolate import CubicHermiteSpline

        course = CubicHermiteSpline(self.time, self.angle, self.speed)
        return np.asarray(course(np.clip(time, 0.0, self.duration)))


def time_optimal(
    model: ServoModel,
    bounds: Limits,
    start: float,
    goal: float,
    *,
    intervals: int = 100,
    speed_limit: float = float("inf"),
) -> Trajectory:
    """Move from rest at one angle to rest at another in the shortest time T within the bounds.

        minimise    T
        subject to  the servo model with its effects, at rest at both ends
                    min_torque <= s_i xi_i <= max_torque
                    s_i (xi_i - r^2 Jm A_i x'') - r f >= min_torque     at the start and the end of each interval
                    |x'| <= speed_limit

    The third constraint is the contact torque (see `allocation.Limits`): contact is kept. For inertia alone the
    solution is known: T = 2 sqrt(J |goal - start|/tau), tau = (Nf/N)(max_torque - min_torque), half of the time
    accelerating and half of it braking.

    The plan is for the load with contact: dynamics of the drive (dead time, lag, rate limit), compliance, backlash
    and sensor are left out. With dry friction the load slides in one direction; a move with a stop on the way is not
    considered. The jump of a dead zone is approximated by a steep slope; `miss` shows the resulting error.

    Args:
        model: the servo, on a rotary axis.
        bounds: of two drives on one joint.
        start, goal: angles [rad].
        intervals: N.
        speed_limit: greatest speed of the load [rad/s]. The rate of the torque is not limited.

    Raises:
        BadParameter: a linear axis, other drives, angles that are equal or not finite, fewer than two intervals, a
            speed limit that is not above zero, or bounds without torque in one of the directions.
    """
    return _solved(_move(model, bounds, start, goal, intervals, speed_limit), None)


def minimum_copper_loss(
    model: ServoModel,
    bounds: Limits,
    start: float,
    goal: float,
    duration: float,
    *,
    intervals: int = 100,
    speed_limit: float = float("inf"),
) -> Trajectory:
    """Move from rest to rest in a given time [s] with the least integral of xi1^2 + xi2^2.

    Constraints, arguments and errors are those of `time_optimal`; the duration must be above zero. If it is too short,
    the status is "failed".
    """
    if not (np.isfinite(duration) and duration > 0):
        raise BadParameter(f"The duration of a move must be finite and above zero, not {duration!r} s.")
    return _solved(_move(model, bounds, start, goal, intervals, speed_limit), float(duration))


def _move(model: ServoModel, bounds: Limits, start: float, goal: float, intervals: int, speed_limit: float) -> Shooting:
    if model.axis != "rotary":
        raise BadParameter("A move is planned for a load behind gears; give it a model of a rotary axis.")
    if bounds.structure.matrix.shape != (1, 2):
        raise BadParameter("A move is planned for two drives on one joint.")
    if not (np.isfinite(start) and np.isfinite(goal)) or start == goal:
        raise BadParameter(f"A move needs two different and finite angles, not {start!r} and {goal!r}.")
    if (whole(intervals) or 0) < 2:
        raise BadParameter(f"intervals must be a whole number of at least 2, not {intervals!r}.")
    if not speed_limit > 0:
        raise BadParameter(f"speed_limit must be above zero, not {speed_limit!r}.")
    low, high = bounds.reachable()
    if not low < 0 < high:
        raise BadParameter(f"The bounds leave output torques from {low:g} to {high:g} N m: none to brake with.")
    planned = model.without_clock()
    for effect in planned.effects:
        late = effect.stage == Stage.ACTUATOR and (effect.states or effect.name == "input_delay")
        if late or effect.flexible or effect.stage == Stage.SENSOR:
            planned = planned.without_effect(effect.name)
    return Shooting(
        model=planned,
        bounds=bounds,
        start=float(start),
        goal=float(goal),
        intervals=intervals,
        speed_limit=float(speed_limit),
    )


def _solved(move: Shooting, duration: float | None) -> Trajectory:
    """Solve the program, and check the solution by a simulation of the model with its torques."""
    shot, bounds, N = move.solve(duration), move.bounds, move.intervals
    torques, h = bounds.structure.signs * shot.magnitudes, shot.duration / N
    output_torque = shot.magnitudes @ bounds.structure.pushing[0]
    course = simulate(move.model, command=np.repeat(output_torque, _FINER), dt=h / _FINER, state=move.begin)
    acceleration = np.diff(course[:, 1]) / (h / _FINER)
    fine = np.repeat(torques, _FINER, axis=0)
    return Trajectory(
        time=np.arange(N + 1, dtype=np.float64) * h,
        angle=shot.states[:, 0].copy(),
        speed=shot.states[:, 1].copy(),
        output_torque=output_torque,
        torques=torques,
        copper_loss=float(np.sum(torques**2) * h),
        margin=float(np.min(bounds.margin(fine, acceleration))),
        miss=course[-1, :2] - [move.goal, 0.0],
        status="optimal" if shot.outcome == "Solve_Succeeded" else f"failed: {shot.outcome.replace('_', ' ')}",
    )
