"""The result of the allocator: torques, delivered torque, active limits, and the certificate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plant.result_display import Drawn

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Allocation(Drawn):
    """Torques allocated to the drives, with the certificate of optimality.

    Attributes:
        torques: (m,) torques of the drives (pinions) [N m], always inside their limits.
        preload: lambda of equation (3) [N m per tooth]; for a structure other than a gear train, the component of the
            torques along its `null_vector` [N m].
        status: "optimal", or "degraded: " and the reason.
        binding: names of the rows that hold with equality, as "drive 1: minimum torque".
        margin: smallest motor or contact torque minus the minimum, seen from the drive [N m]; contact may be lost if
            it is negative.
        missing_torque: demanded minus delivered torque [N m]; a number for one joint, (n,) for several.
        copper_loss: sum of xi_i^2 [N^2 m^2], proportional to the Joule heat.
        floor: (m,) minimum torque plus friction now required of each drive [N m]; it rises from zero while the
            preload is built up.
        primal_residual, dual_residual, duality_gap: distance from the optimum, with torques in units of the greatest
            torque; inf if no solution was found.
    """

    torques: Array
    preload: float
    status: str
    binding: tuple[str, ...]
    margin: float
    missing_torque: float | Array
    copper_loss: float
    floor: Array
    primal_residual: float
    dual_residual: float
    duality_gap: float

    def __repr__(self) -> str:
        """Torques and status in one line."""
        torques = ", ".join(f"{torque:.4g}" for torque in self.torques)
        return f"Allocation({torques} N m, margin {self.margin:.4g} N m, {self.status})"

    def is_optimal(self, tol: float) -> bool:
        """Whether the demand is met with least effort within `tol`, with torques in units of the greatest torque."""
        return self.status == "optimal" and max(self.primal_residual, self.dual_residual, self.duality_gap) <= tol
