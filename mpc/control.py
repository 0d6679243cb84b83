"""What a controller hands out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Control:
    """What the controller hands out at one sample.

    Attributes:
        torques: (2,) pinion torques to apply now [N m]; always inside the bounds.
        status: "optimal", or "degraded: " and why.
        margin: least predicted flank torque above the minimum [N m], over both drives and the horizon, seen from the
            pinion; negative where `max_torque` cannot hold the teeth together.
        predicted_torques: (N, 2) pinion torques over the horizon [N m], the first row being `torques`.
        predicted_angle: (N + 1,) load angle from now on [rad], a delay of whole samples being left out.
        disturbance: estimated torque that the model does not know [N m].
        residual: how far from optimal, see `mpc.programme.Programme.residual`.
    """

    torques: Array
    status: str
    margin: float
    predicted_torques: Array
    predicted_angle: Array
    disturbance: float
    residual: float
