"""Check of the arguments of a step."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpc.estimator import NO_ANGLES
from plant.errors import BadParameter

Array = NDArray[np.float64]


def take_reference(reference: ArrayLike, wanted: Array) -> bool:
    """Write the reference into `wanted` (N + 1,); returns whether it is an array and not a number."""
    given = np.asarray(reference, dtype=np.float64)
    if given.shape not in ((), wanted.shape):
        raise BadParameter(
            f"The reference must be a number or {wanted.size} samples, not an array of shape {given.shape}."
        )
    wanted[: given.size] = given
    return given.ndim == 1


def take_motor_angles(angles: ArrayLike | None, resolution: float | None, drives: int) -> ArrayLike:
    """(2,) measured motor angles, NaN for a missing one."""
    if resolution is None:
        raise BadParameter("Give the controller a motor_resolution, or no motor angles.")
    if angles is None:
        return NO_ANGLES
    given = np.asarray(angles, dtype=np.float64)
    if given.shape != (drives,):
        count = "two angles" if drives > 1 else "one angle"
        raise BadParameter(f"motor_angles must be {count}, not an array of shape {given.shape}.")
    return given if drives > 1 else np.append(given, np.nan)


def take_elapsed(elapsed: float) -> float:
    """The time since the last step [s], checked."""
    if not (np.isfinite(elapsed) and elapsed > 0):
        raise BadParameter(f"elapsed must be a time above zero since the last step, not {elapsed!r}.")
    return elapsed
