"""The structure matrix: which drive acts on which joint, and its null space."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allocation.admissible import Admissibility, admissible, null_space, structure_matrix
from plant.drive_train import DriveTrain
from plant.errors import BadParameter

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Structure:
    """n joints driven by m drives; each drive gives torque in one direction only.

        tau = A xi,     d(phi)/dt = A' d(theta)/dt

    with joint torques tau (n,), drive torques xi (m,), joint angles theta (n,) and drive angles phi (m,). For two
    pinions on one output gear these are equations (2) and (1) of the drive/anti-drive paper. The second follows from
    the first because the gear meshes are lossless.

    Attributes:
        A: (n, m) torque on each joint for one newton metre of each drive.
        directions: (m,) +1 or -1, the required sign of each drive torque; all +1 if the signs of the columns of
            A already contain the directions, as in Chang and Tsai (1993).
        reduction: turns of a motor for one turn of its drive; a number, or one for each.

    Raises:
        BadParameter: A is not a finite matrix, a direction is not +1 or -1, or the reduction is not positive.
    """

    A: ArrayLike
    _: KW_ONLY
    directions: tuple[int, ...] | None = None
    reduction: float | tuple[float, ...] = 1.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        matrix = structure_matrix(self.A)
        directions = (1,) * matrix.shape[1] if self.directions is None else tuple(self.directions)
        if len(directions) != matrix.shape[1] or not set(directions) <= {1, -1}:
            raise BadParameter(
                f"directions must be +1 or -1 for each of the {matrix.shape[1]} drives, not {self.directions!r}."
            )
        turns = np.asarray(self.reduction, dtype=np.float64)
        if turns.shape not in ((), (len(directions),)) or not np.all(np.isfinite(turns) & (turns > 0)):
            raise BadParameter(f"reduction must be finite and above zero, not {self.reduction!r}.")
        matrix.setflags(write=False)
        object.__setattr__(self, "A", matrix)
        object.__setattr__(self, "directions", directions)

    @classmethod
    def of(cls, machine: DriveTrain | Structure | ArrayLike) -> Structure:
        """The structure of a drive train (equation 2), or of a matrix with the directions as signs of its columns."""
        if isinstance(machine, Structure):
            return machine
        if isinstance(machine, DriveTrain):
            reduction = tuple(machine.pre_reductions.tolist())
            return cls(machine.torque_map[None, :], directions=machine.directions, reduction=reduction)
        return cls(machine)

    @cached_property
    def reductions(self) -> Array:
        """(m,) turns of each motor for one turn of its drive."""
        return np.broadcast_to(np.asarray(self.reduction, dtype=np.float64), (self.drives,)).copy()

    @property
    def matrix(self) -> Array:
        """A as an array (n, m), read only."""
        return np.asarray(self.A, dtype=np.float64)

    @cached_property
    def signs(self) -> Array:
        """The directions +1 or -1 of the drives as an array, (m,)."""
        return np.array(self.directions, dtype=np.float64)

    @cached_property
    def pushing(self) -> Array:
        """A for torque magnitudes, (n, m): torque on each joint for one newton metre of each drive in its direction."""
        return self.matrix * self.signs

    @cached_property
    def admissibility(self) -> Admissibility:
        """Whether the drives can keep every joint free of backlash, see `admissible`."""
        return admissible(self.pushing)

    @cached_property
    def null_vector(self) -> Array:
        """Drive torques (m,) without joint torque that preload all meshes as evenly as possible, at most 1 N m."""
        vector = self.admissibility.null_vector
        return np.asarray(self.signs * vector / max(float(np.max(vector)), np.finfo(float).tiny))

    @cached_property
    def null_space(self) -> Array:
        """Orthonormal basis (m, m - n) of the drive torques without joint torque, see `null_space`."""
        return null_space(self.matrix)

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return int(self.matrix.shape[0])

    @property
    def drives(self) -> int:
        """Number of drives, m."""
        return int(self.matrix.shape[1])
