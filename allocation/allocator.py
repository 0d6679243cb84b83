"""The allocator: joint torques in, drive torques out, with a certificate."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allocation.allocation import Allocation
from allocation.general_allocation import CERTIFIED, share, share_in_closed_form
from allocation.limits import Limits, PerDrive, per_drive
from allocation.loss import loss, still_preloaded
from allocation.qp import check_solver
from allocation.quadratic_program import UNPROVEN, Residuals
from allocation.rows import Rows
from allocation.structure import Structure
from plant.drive_train import DriveTrain
from plant.errors import BadParameter
from plant.number import refuse_huge

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Allocator:
    """Share a torque among unidirectional drives with least effort; a single drive gives all of it, in both directions.

        minimise    sum w_i xi_i^2
        subject to  A xi = tau                        (equation 2: -(Nf/N1) xi1 - (Nf/N2) xi2 = tau)
                    min_torque <= sigma_i xi_i <= max_torque           (xi1 >= min_torque, xi2 <= -min_torque)
                    contact torque of each drive >= min_torque         (see `Limits`)
                    |change of xi_i| <= torque_rate dt,  |change of the preload| <= preload_rate dt

    If not all of these can hold, motor limits have priority over the preload, and the preload over the torque: the
    result is the reachable torque nearest to the demand, with least effort. Two drives have a closed form. For any
    other structure a quadratic program is solved exactly and its solution is certified
    (see `allocation.general_allocation`).

    Attributes:
        gears: a drive train, a `Structure`, or its matrix A (n, m) with the directions as the signs of the columns.
        min_torque: minimum motor and contact torque of each drive, seen from the drive (pinion) [N m]. It has to cover
            vibration at the gear contact.
        max_torque: greatest torque of each drive in its direction [N m].
        reverse_torque: greatest torque of a drive against its direction [N m], used when the loss of another drive
            leaves it without preload; None: same as `max_torque`. Zero for drives that cannot reverse.
        weights: w; a larger weight reduces the torque of that drive.
        rotor_inertia: of each motor at its shaft [kg m^2]; zero neglects the rotors.
        motor_friction: dry friction of each motor at its shaft [N m], always subtracted from the contact torque.
        torque_rate: greatest rate of each torque [N m/s].
        preload_rate: greatest rate of each drive's part of the preload [N m/s], see `Rows`; with it the preload is
            built up gradually from rest. It does not limit the torque that other limits require.
        lost: numbers, from 1, of the drives that give no torque.
        solver: a QP solver available in qpsolvers. None: the closed form for two drives, otherwise OSQP.

    A number that applies to each drive may be a tuple with one entry per drive.

    Raises:
        BadParameter: a number out of range, a structure that is not admissible, or a solver that is not installed.
        InfeasibleTorque: min_torque above max_torque.
    """

    gears: DriveTrain | Structure | ArrayLike
    _: KW_ONLY
    min_torque: PerDrive
    max_torque: PerDrive
    reverse_torque: PerDrive | None = None
    weights: PerDrive = 1.0
    rotor_inertia: PerDrive = 0.0
    motor_friction: PerDrive = 0.0
    torque_rate: float = np.inf
    preload_rate: float = np.inf
    lost: tuple[int, ...] = ()
    solver: str | None = None

    def __post_init__(self) -> None:
        """Check every field."""
        if not isinstance(self.gears, DriveTrain):
            object.__setattr__(self, "gears", Structure.of(self.gears))
        structure = self.bounds.structure
        if np.any(self._weights == 0):
            raise BadParameter(f"weights must be above zero, not {self.weights!r}.")
        if self.reverse_torque is not None:
            per_drive("reverse_torque", self.reverse_torque, structure.drives)
        for name in ("torque_rate", "preload_rate"):
            if not getattr(self, name) > 0:
                raise BadParameter(f"{name} must be above zero, not {getattr(self, name)!r}.")
        numbers = set(range(1, structure.drives + 1))
        if not set(self.lost) < numbers or len(set(self.lost)) != len(self.lost):
            raise BadParameter(f"lost must name some of the drives 1 to {len(numbers)}, not all: {self.lost!r}.")
        if not isinstance(self.gears, DriveTrain) and not structure.admissibility.admissible:
            raise BadParameter(
                "These drives cannot hold every joint free of backlash: A must have full rank and a strictly positive "
                "null vector; `admissible_directions` tells the directions that would do."
            )
        if self.solver is not None:
            check_solver(self.solver)
        _ = self.preloaded  # a linear program, better now than in the loop

    @cached_property
    def bounds(self) -> Limits:
        """Torque limits of each drive."""
        machine = self.gears
        return Limits(
            gears=machine if isinstance(machine, DriveTrain) else Structure.of(machine),
            min_torque=self.min_torque,
            max_torque=self.max_torque,
            rotor_inertia=self.rotor_inertia,
            motor_friction=self.motor_friction,
        )

    @cached_property
    def preloaded(self) -> NDArray[np.bool_]:
        """(m,) which drives can be preloaded, given the lost drives; a single drive cannot."""
        drives = self.bounds.structure.drives
        return still_preloaded(self.bounds.structure, self.lost) if self.lost else np.full(drives, drives > 1)

    def without(self, drive: int) -> Allocator:
        """The allocator for the case that one more drive (number from 1) gives no torque."""
        return replace(self, lost=(*self.lost, drive))

    def at_rest(self) -> Allocation:
        """No torque and no preload: the `before` of the first `allocate`, from which the preload is built up."""
        nothing, demand = np.zeros(self.bounds.structure.drives), np.zeros(self.bounds.structure.joints)
        still = self._motion(0.0)
        return self._allocation(nothing, demand, still, floor=nothing, troubles=["at rest, without preload"])

    def allocate(
        self,
        torque: ArrayLike,
        acceleration: ArrayLike = 0.0,
        *,
        before: Allocation | None = None,
        dt: float | None = None,
    ) -> Allocation:
        """Share one torque at one acceleration.

        Args:
            torque: on the joint (output gear) [N m]; on several joints (n,).
            acceleration: of the joint [rad/s^2]; of several joints (n,).
            before: the result of the previous step, reference of the rate limits. None: no rate limits.
            dt: the step [s]; required with `before`.

        Raises:
            BadParameter: a number that is not finite or of the wrong shape, or a step that is not positive.
        """
        demand, a = self._per_joint("torque", torque), self._motion(acceleration)
        if before is not None and not (dt is not None and np.isfinite(dt) and dt > 0):
            raise BadParameter(f"With `before`, dt must be finite and above zero, not {dt!r}.")
        if before is not None and before.torques.shape != self._weights.shape:
            raise BadParameter(
                f"`before` holds {before.torques.size} torques, but there are {self._weights.size} drives."
            )
        floor = self._floor(before, dt or 0.0)
        steady = Rows.of(self.bounds, a, floor).without(self._lost, ~self.preloaded, self._reverse)
        rows = steady if before is None else self._limited(steady, before, dt or 0.0)
        B, binding_within = self.bounds.structure.pushing, CERTIFIED * float(np.max(self.bounds.greatest))
        if self.solver is None and B.shape == (1, 2):
            sharing = share_in_closed_form(B, demand, rows, self._weights)
        else:
            sharing = share(B, demand, rows, self._weights, self.solver or "osqp")
        binding = rows.binding(sharing.x, binding_within)
        missing = float(np.linalg.norm(demand - B @ sharing.x))
        troubles = [*loss(self._lost, self.preloaded)]
        if np.any((self.bounds.lower(a, floor) > self.bounds.greatest) & self.preloaded):
            troubles.append("max_torque is too low to keep contact at this acceleration")
        if np.any(rows.lower < steady.lower):
            troubles.append("torque_rate holds the preload back")
        if np.any(floor < self.bounds.floor):
            troubles.append("the preload is being built up")
        if missing > binding_within * np.linalg.norm(B):
            troubles.append(f"{missing:.3g} N m of the torque are out of reach ({', '.join(binding)})")
        if sharing.instead:
            troubles.append(f"{self.solver or 'osqp'} was not certified, {sharing.instead} is used")
        return self._allocation(
            sharing.x, demand, a, floor=floor, troubles=troubles, binding=binding, residuals=sharing.residuals
        )

    @cached_property
    def _weights(self) -> Array:
        return per_drive("weights", self.weights, self.bounds.structure.drives)

    @cached_property
    def _reverse(self) -> Array:
        value = self.max_torque if self.reverse_torque is None else self.reverse_torque
        return per_drive("reverse_torque", value, self.bounds.structure.drives)

    @cached_property
    def _lost(self) -> NDArray[np.bool_]:
        return np.isin(np.arange(1, self.bounds.structure.drives + 1), self.lost)

    def _per_joint(self, name: str, value: ArrayLike) -> Array:
        """(n,) finite numbers; a scalar is accepted for one joint, and zero for several."""
        numbers, n = np.asarray(value, dtype=np.float64), self.bounds.structure.joints
        if not np.all(np.isfinite(numbers)):
            raise BadParameter(f"The {name} must be finite, not {value!r}.")
        refuse_huge(name, float(np.max(np.abs(numbers), initial=0.0)))
        if numbers.shape != (n,) and not (numbers.ndim == 0 and (n == 1 or numbers == 0)):
            raise BadParameter(f"The {name} needs a number for each of the {n} joints, not {value!r}.")
        return np.broadcast_to(numbers, (n,))

    def _motion(self, acceleration: ArrayLike) -> Array:
        """Accelerations as `Limits` takes them: (n,), or a number for one joint."""
        numbers = self._per_joint("acceleration", acceleration)
        return numbers if len(numbers) > 1 else numbers[0]

    def _floor(self, before: Allocation | None, dt: float) -> Array:
        """(m,) minimum torque plus friction required now [N m]: moves from its previous value at `preload_rate`."""
        full, change = self.bounds.floor, self.preload_rate * dt
        return full if before is None else np.clip(full, before.floor - change, before.floor + change)

    def _limited(self, rows: Rows, before: Allocation, dt: float) -> Rows:
        """The rows narrowed by the rate limits; if a drive is lost, the preload rate is not limited."""
        x = self.bounds.structure.signs * before.torques
        if np.isfinite(self.torque_rate):
            rows = rows.limit_rate(x, self.torque_rate * dt, exempt=self._lost)
        if np.isfinite(self.preload_rate) and not self.lost:
            rows = rows.limit_preload_rate(x, self.preload_rate * dt)
        return rows

    def _allocation(
        self,
        x: Array,
        demand: Array,
        acceleration: Array,
        *,
        floor: Array,
        troubles: list[str],
        binding: tuple[str, ...] = (),
        residuals: Residuals = UNPROVEN,
    ) -> Allocation:
        """The `Allocation` with these torque magnitudes (m,)."""
        structure, v = self.bounds.structure, self.bounds.gears.null_vector
        torques = structure.signs * x + 0.0  # no negative zero
        missing = demand - structure.matrix @ torques
        return Allocation(
            torques=torques,
            preload=float(torques @ v / max(float(v @ v), np.finfo(float).tiny)),
            status=f"degraded: {'; '.join(troubles)}" if troubles else "optimal",
            binding=binding,
            margin=float(self.bounds.margin(torques, acceleration)),
            missing_torque=float(missing[0]) if structure.joints == 1 else missing,
            copper_loss=float(torques @ torques),
            floor=floor,
            primal_residual=residuals.primal,
            dual_residual=residuals.dual,
            duality_gap=residuals.gap,
        )
