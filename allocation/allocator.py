"""The allocator: one follower torque in, two pinion torques out, with a certificate."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property

import numpy as np
import qpsolvers
from numpy.typing import NDArray

from allocation.bounds import Bounds
from allocation.least_effort import least_effort, preload_interval
from allocation.qp import check_solver, largest_residual, solve_qp
from plant.errors import BadParameter
from plant.gears import GearTrain

Array = NDArray[np.float64]

_CERTIFIED = 1e-6
"""Largest residual of an accepted solution, with torques in units of the greatest torque."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Allocation:
    """How a follower torque is shared, and the proof that it is shared well.

    Attributes:
        torques: (2,) pinion torques [N m], always inside the bounds.
        preload: lambda of equation (3) [N m per tooth].
        status: "optimal", or "degraded: " and why.
        margin: least flank torque above the minimum, seen from the pinion [N m]; negative if a flank may open.
        missing_torque: demanded less delivered follower torque [N m].
        heat: xi1^2 + xi2^2 [N^2 m^2], to which the Joule heat is proportional.
        primal_residual, dual_residual, duality_gap: how far from optimal, with torques in units of the greatest
            torque; inf if no solution was found.
    """

    torques: Array
    preload: float
    status: str
    margin: float
    missing_torque: float
    heat: float
    primal_residual: float
    dual_residual: float
    duality_gap: float

    def is_optimal(self, tol: float) -> bool:
        """Whether the demand is met at least effort within `tol`, with torques in units of the greatest torque."""
        return self.status == "optimal" and max(self.primal_residual, self.dual_residual, self.duality_gap) <= tol


@dataclass(frozen=True)
class Allocator:
    """Share a follower torque among two unidirectional drives at least effort.

        minimise    w1 xi1^2 + w2 xi2^2
        subject to  -(Nf/N1) xi1 - (Nf/N2) xi2 = tau                           (equation 2)
                    xi1 >= min_torque,  xi2 <= -min_torque,  |xi_i| <= max_torque
                    flank torque of each drive >= min_torque                   (see `Bounds`)

    Equation (3) meets the first constraint for every lambda, so the programme is solved in lambda: the torque is then
    exact whatever the solver does, and the problem is feasible up to the very edge of reach.

    A torque out of reach is answered by the reachable torque nearest to it: the preload comes first.

    Attributes:
        gears: the gear train.
        min_torque: least torque of each pinion and flank, seen from the pinion [N m]. It has to cover what friction
            of the motors and vibration of the teeth take.
        max_torque: greatest torque of each pinion [N m].
        weights: w1, w2; larger spares that drive.
        rotor_inertia: of each motor at its shaft [kg m^2]; zero leaves rotors out.
        solver: any dense QP solver that qpsolvers finds.

    Raises:
        BadParameter: a number out of range, or a solver that is not installed.
        InfeasibleTorque: min_torque above max_torque.
    """

    gears: GearTrain
    _: KW_ONLY
    min_torque: float
    max_torque: float
    weights: tuple[float, float] = (1.0, 1.0)
    rotor_inertia: float = 0.0
    solver: str = "osqp"

    def __post_init__(self) -> None:
        """Check every field."""
        if len(self.weights) != 2 or not all(np.isfinite(w) and w > 0 for w in self.weights):
            raise BadParameter(f"weights must be two positive numbers, not {self.weights!r}.")
        check_solver(self.solver)
        _ = self.bounds

    @cached_property
    def bounds(self) -> Bounds:
        """What each drive may do."""
        return Bounds(
            gears=self.gears,
            min_torque=self.min_torque,
            max_torque=self.max_torque,
            rotor_inertia=self.rotor_inertia,
        )

    def allocate(self, torque: float, acceleration: float = 0.0) -> Allocation:
        """Share one follower torque [N m] at one load acceleration [rad/s^2] by the quadratic programme.

        The solution is certified by its residuals; if the solver fails, the closed form stands in and the status says
        so.

        Raises:
            BadParameter: a number that is not finite.
        """
        if not np.isfinite(torque) or not np.isfinite(acceleration):
            raise BadParameter(f"Torque and acceleration must be finite, not {torque!r} and {acceleration!r}.")
        least, greatest = self.bounds.reachable(acceleration)
        demand = float(np.clip(torque, least, greatest))
        solution = self._solve(demand, acceleration)
        certified = largest_residual(solution) <= _CERTIFIED
        if certified and solution.x is not None:
            preload = float(solution.x[0]) * self._preload_scale
            torques = self.bounds.clip(self.gears.split(demand, preload))
        else:
            torques = least_effort(self.bounds, demand, acceleration, self.weights)
        result = self._result(torques, torque, acceleration, solution)
        if np.any(self.bounds.lower(acceleration) > self.max_torque):
            return replace(result, status="degraded: max_torque cannot hold the teeth together at this acceleration")
        if demand != torque:
            return replace(result, status=f"degraded: {abs(torque - demand):.3g} N m of the torque are out of reach")
        if not certified:
            return replace(result, status=f"degraded: {self.solver} was not certified, the closed form stands in")
        return result

    @property
    def _preload_scale(self) -> float:
        """Unit of the programme's variable [N m per tooth]: lambda that puts max_torque on the larger pinion."""
        return self.max_torque / max(self.gears.pinion_teeth)

    def _solve(self, torque: float, acceleration: float) -> qpsolvers.Solution:
        """Solve for lambda in units of `_preload_scale`, torques in units of `max_torque`."""
        p, interval = preload_interval(self.bounds, torque, acceleration)
        v = self.gears.null_vector / max(self.gears.pinion_teeth)
        w = np.asarray(self.weights) / max(self.weights)
        return solve_qp(
            P=np.array([[v @ (w * v)]]),
            q=np.array([(p / self.max_torque) @ (w * v)]),
            lb=interval[:1] / self._preload_scale,
            ub=interval[1:] / self._preload_scale,
            solver=self.solver,
        )

    def _result(self, torques: Array, demand: float, acceleration: float, solution: qpsolvers.Solution) -> Allocation:
        """The allocation that these torques are."""
        v = self.gears.null_vector
        return Allocation(
            torques=torques,
            preload=float(torques @ v / (v @ v)),
            status="optimal",
            margin=float(self.bounds.margin(torques, acceleration)),
            missing_torque=float(demand - self.gears.follower_torque(torques)),
            heat=float(torques @ torques),
            primal_residual=float(solution.primal_residual()),
            dual_residual=float(solution.dual_residual()),
            duality_gap=float(abs(solution.duality_gap())),
        )
