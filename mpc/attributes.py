"""Check of the attributes of a controller, one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from plant.errors import BadParameter
from plant.gears import GearTrain
from plant.number import finite, refuse_huge, whole

_LONGEST = 2000
"""Longest horizon in samples: the memory grows with it, and the automatic tuning solves for the whole horizon."""

_FASTEST = 0.1
"""Highest bandwidth, in units of the sampling rate."""

_PASSES = 100
"""Greatest number of quadratic programs in a sample."""

_ABOVE_ZERO = ("sample_time", "bandwidth")
_NOT_NEGATIVE = (
    *("encoder_resolution", "encoder_noise", "encoder_range", "torque_noise", "disturbance_rate"),
    *("motor_resolution", "motor_noise", "friction_std"),
)
_LIMITS = ("torque_rate", "preload_rate", "speed_limit")
_OPTIONAL = ("bandwidth", "horizon", "disturbance_rate", "motor_resolution")


def check(given: Any) -> None:
    """Raise `BadParameter` for an invalid attribute of a `Controller`; None stands for a number chosen later."""
    if given.model.axis == "linear" and isinstance(given.gears, GearTrain):
        raise BadParameter(
            "A linear axis has no gear train; give Ratios of its drives in N/(N m), such as Ratios(ratios=(62.8,))."
        )
    if given.model.torque_unit is not None:
        raise BadParameter(
            f"The controller gives torques in N m, the model is in {given.model.torque_unit}: identify it from a "
            "log of the torque, or of the current with its torque constant."
        )
    for name in _ABOVE_ZERO:
        _refuse_unless(given, name, "finite and above zero", lambda number: number > 0.0)
    for name in _NOT_NEGATIVE:
        _refuse_unless(given, name, "finite and not negative", lambda number: number >= 0.0)
    for name in _LIMITS:
        if getattr(given, name) != float("inf"):
            _refuse_unless(given, name, "above zero", lambda number: number > 0.0)
    _refuse_unless_whole(given, "horizon", 2, _LONGEST)
    _refuse_unless_whole(given, "sqp_iterations", 1, _PASSES)
    slowest, fastest = 0.25 / (_LONGEST * given.sample_time), _FASTEST / given.sample_time
    if given.bandwidth is not None and not slowest <= given.bandwidth <= fastest:
        raise BadParameter(
            f"bandwidth must be between {slowest:.3g} and {fastest:.3g} Hz at a sample time of {given.sample_time:g} "
            f"s, not {given.bandwidth:g} Hz."
        )
    if 0.0 < given.encoder_range <= given.encoder_resolution:
        raise BadParameter(
            f"encoder_range = {given.encoder_range:g} must be above encoder_resolution = {given.encoder_resolution:g}, "
            "or zero for an encoder whose measurements go on."
        )


@contextmanager
def computable(given: Any) -> Iterator[None]:
    """Turn an overflow or a singular matrix, caused by numbers out of proportion, into a `BadParameter`."""
    try:
        with np.errstate(over="raise", invalid="raise"):
            yield
    except (ArithmeticError, np.linalg.LinAlgError):
        model = given.model
        raise BadParameter(
            f"No controller can be computed for sample_time = {given.sample_time:g}, max_torque = {given.max_torque}, "
            f"gears {given.gears}, inertia = {model.inertia:g}, viscous_friction = {model.viscous_friction:g}, "
            f"encoder_resolution = {given.encoder_resolution:g}, encoder_noise = {given.encoder_noise:g}: they are out "
            "of proportion; check their units (SI)."
        ) from None


def _refuse_unless(given: Any, name: str, what: str, allowed: Callable[[float], bool]) -> None:
    """Raise `BadParameter` unless the attribute is a finite and allowed number."""
    value = getattr(given, name)
    if value is None and name in _OPTIONAL:
        return
    number = finite(value)
    if number is None or not allowed(number):
        raise BadParameter(f"{name} must be {what}, not {value!r}.")
    refuse_huge(name, number)


def _refuse_unless_whole(given: Any, name: str, least: int, most: int) -> None:
    value = getattr(given, name)
    if value is None and name in _OPTIONAL:
        return
    number = whole(value)
    if number is None or not least <= number <= most:
        raise BadParameter(f"{name} must be a whole number from {least} to {most}, not {value!r}.")
