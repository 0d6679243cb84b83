"""What a controller may be asked for: each number by itself, before anything is made of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from plant.errors import BadParameter
from plant.gears import GearTrain
from plant.number import whole


def check(asked: Any) -> None:
    """Refuse the attributes of a `Controller` that it cannot have with a `BadParameter`; None is chosen later."""
    if asked.model.axis == "linear" and isinstance(asked.gears, GearTrain):
        raise BadParameter(
            "A linear axis has no gear train; give Ratios of its drives in N/(N m), such as Ratios(ratios=(62.8,))."
        )
    if asked.model.torque_unit is not None:
        raise BadParameter(
            f"The controller gives torques in N m, the model is in {asked.model.torque_unit}: identify it from a "
            "log of the torque, or of the current with its torque constant."
        )
    for name in ("sample_time", "bandwidth"):
        value = getattr(asked, name)
        if value is not None and not (np.isfinite(value) and value > 0):
            raise BadParameter(f"{name} must be finite and above zero, not {value!r}.")
    if asked.horizon is not None and (whole(asked.horizon) or 0) < 2:
        raise BadParameter(f"horizon must be a whole number of at least 2 samples, not {asked.horizon!r}.")
    if not (np.isfinite(asked.encoder_range) and asked.encoder_range >= 0):
        raise BadParameter(f"encoder_range must be finite and not negative, not {asked.encoder_range!r}.")
    for name in ("torque_rate", "preload_rate"):
        if not getattr(asked, name) > 0:
            raise BadParameter(f"{name} must be above zero, not {getattr(asked, name)!r}.")
    if not (np.isfinite(asked.friction_std) and asked.friction_std >= 0):
        raise BadParameter(f"friction_std must be finite and not negative, not {asked.friction_std!r}.")
    if (whole(asked.sqp_iterations) or 0) < 1:
        raise BadParameter(f"sqp_iterations must be a whole number above zero, not {asked.sqp_iterations!r}.")
