"""Families of smooth functions: basis functions of the unmodelled torque and of the measurement error.

They represent what no effect explains (Kennedy and O'Hagan 2001). Each function is a column along the log: a torque
over velocity, angle, torque, time, angle and velocity together, a lagged torque, or a torque over the travel since the
last reversal. If the load moves more than one turn, functions that repeat with each turn are added. The prior size of
the k-th function is proportional to 1/k.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from plant.effects import Motion
from plant.effects.effect import Array

_HIGHEST_ORDER = 10  # highest order k of a function of one variable
_LAGS = (2.0, 6.0, 20.0, 60.0)  # time constants of a lagged torque, in samples
_TRAVELS = (0.003, 0.03, 0.3)  # travel constants of the Dahl model, as shares of the range of angles


@dataclass(frozen=True, kw_only=True, eq=False)
class Families:
    """Columns of unit size: torques are scaled to the rms torque in the log, measurement errors to unit noise.

    Attributes:
        torque: (T, M) [N m].
        measurement: (T, R) measurement errors, for a noise of 1 rad [rad].
        variables: (M + R,) the variable of each column, torques first.
    """

    torque: Array
    measurement: Array
    variables: tuple[str, ...]

    @classmethod
    def along(cls, motion: Motion) -> Families:
        """The families along a motion."""
        level = float(np.sqrt(np.mean(motion.torque**2)))
        torques, measurement_errors = _of_unit_size(_torques(motion)), _of_unit_size(_measurement_errors(motion))
        nothing = np.empty((motion.time.size, 0))
        return cls(
            torque=np.column_stack([nothing, *(level * column for _, column in torques)]),
            measurement=np.column_stack([nothing, *(column for _, column in measurement_errors)]),
            variables=tuple(variable for variable, _ in (*torques, *measurement_errors)),
        )


def _of_unit_size(members: Iterator[tuple[str, float, Array]]) -> list[tuple[str, Array]]:
    """Variable and column (T,) of each function that is not zero; its rms is its weight."""
    scaled = ((variable, weight, _unit(column)) for variable, weight, column in members)
    return [(variable, weight * column) for variable, weight, column in scaled if column is not None]


def _torques(motion: Motion) -> Iterator[tuple[str, float, Array]]:
    """Variable, weight and column (T,) of each torque."""
    velocity, angle = _to_one(motion.velocity), _to_one(motion.angle)
    speed, direction = np.abs(2.0 * velocity - 1.0), motion.sign
    yield "nothing", 1.0, np.ones_like(velocity)
    for variable, place in (("velocity", velocity), ("angle", angle), ("torque", _to_one(motion.torque))):
        for k in range(1, _HIGHEST_ORDER + 1):
            yield variable, 1.0 / k, np.cos(np.pi * k * place)
    for k in range(_HIGHEST_ORDER):
        yield "velocity", 1.0 / (k + 1), direction * np.cos(np.pi * k * speed)
    for k in range(1, _HIGHEST_ORDER + 1):
        yield "time", 1.0 / k, np.cos(np.pi * k * _to_one(motion.time))
    around = list(_around(motion)) if motion.turn and np.ptp(motion.angle) > motion.turn else []
    for weight, wave in around:
        yield "angle", weight, wave
    for weight, across in around[:6] or [(1.0 / k, np.cos(np.pi * k * angle)) for k in range(1, 4)]:
        for m in range(1, 4):
            yield "angle and velocity", weight / m, across * np.cos(np.pi * m * velocity)
        yield "angle and velocity", weight, across * direction
    for samples in _LAGS:
        keep = float(np.exp(-1.0 / samples))
        yield "lagged torque", 1.0, motion.by_run(partial(_lagged, motion.torque, keep)) - motion.torque
    for share in _TRAVELS:
        way = share * float(np.ptp(motion.angle))
        yield "travel since reversal", 1.0, motion.by_run(partial(_bristle, motion.angle, way))


def _measurement_errors(motion: Motion) -> Iterator[tuple[str, float, Array]]:
    """Variable, weight and column (T,) of each measurement error: periodic in the angle, or due to a delay.

    On a linear axis the period is the range of travel.
    """
    for weight, wave in _around(motion):
        yield "angle", weight, wave
    yield "velocity", 1.0, motion.velocity
    yield "velocity", 1.0, np.abs(motion.velocity)
    yield "velocity", 1.0, motion.by_run(partial(_before, motion.acceleration))


def _around(motion: Motion) -> Iterator[tuple[float, Array]]:
    """Weight and column (T,) of each harmonic over one turn, or over the range of travel on a linear axis."""
    turned = motion.angle if motion.turn else 2.0 * np.pi * _to_one(motion.angle)
    for k in range(1, _HIGHEST_ORDER + 1):
        yield 1.0 / k, np.sin(k * turned)
        yield 1.0 / k, np.cos(k * turned)


def _before(values: Array, rows: NDArray[np.intp]) -> Array:
    """(T,) values of the sample before, in some rows.

    In a closed loop the torque of a sample depends on the measurement at its start, so it would explain the noise.
    """
    return np.asarray(np.append(values[rows[:1]], values[rows[:-1]]))


def _to_one(values: Array) -> Array:
    """Values scaled from their 0.1 % and 99.9 % quantiles to 0 and 1, clipped."""
    low, high = np.quantile(values, (0.001, 0.999))
    return np.asarray(np.clip((values - low) / max(high - low, 1e-300), 0.0, 1.0))


def _unit(column: Array) -> Array | None:
    """A column scaled to mean square one; None if it is zero."""
    rms = float(np.sqrt(np.mean(column**2)))
    return column / rms if np.isfinite(rms) and rms > 1e-12 * float(np.max(np.abs(column), initial=1e-300)) else None


def _lagged(torque: Array, keep: float, rows: NDArray[np.intp]) -> Array:
    """(T,) a torque after a first-order lag, in some rows."""
    from scipy.signal import lfilter  # scipy.signal takes half a second

    lagged, _ = lfilter([1.0 - keep], [1.0, -keep], torque[rows], zi=[keep * torque[rows[0]]])
    return np.asarray(lagged)


def _bristle(angle: Array, way: float, rows: NDArray[np.intp]) -> Array:
    """(T,) direction of motion, from -1 to 1, with the travel constant `way` (Dahl's model), in some rows."""
    deflection, found = 0.0, np.empty(rows.size)
    for k, step in enumerate(np.diff(angle[rows], prepend=angle[rows[0]]) / max(way, 1e-300)):
        goal = 1.0 if step > 0.0 else -1.0
        deflection = goal + (deflection - goal) * np.exp(-abs(step))
        found[k] = deflection
    return found
