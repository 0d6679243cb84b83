"""The first experiment on a machine of which only the limits are known: the excitation before any log exists.

For a drive with a position loop: a chirp for inertia, lag and compliance; moves with stops for stiction and backlash;
slow reversals for presliding; a staircase of speeds for friction. For a drive with a torque input, the same in torque.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from plant import signals
from plant.effects.effect import Array
from plant.errors import BadParameter
from plant.number import refuse_huge

if TYPE_CHECKING:
    import pandas as pd

_ROOM = 0.9  # fraction of every limit that is used
_REST = 0.5  # duration of a stop [s]
_SAMPLES = 10  # least number of samples in a stop
_MOST = 1e5  # samples per second
_CHIRP = 20.0  # [s]
_FASTEST = 0.05  # highest frequency of the chirp, in cycles per sample
_LEAST = 0.02  # least amplitude of the chirp, as a fraction of half the travel
_MOVES = (1.0, -1.0, 0.5, -0.5, 0.2, -0.2, 0.05, -0.05, 0.0)  # fractions of half the travel
_SLOW = (0.01, 0.03, 0.1)  # fractions of the speed, for slow reversals
_SPEEDS = (0.05, 0.1, 0.2, 0.4, 0.7, 1.0)
_STROKE = 10.0  # longest duration of one stroke [s]
_LEVELS = (0.3, -0.3, 0.6, -0.6, 1.0, -1.0, 0.15, -0.15)  # fractions of the torque


@dataclass(frozen=True, kw_only=True)
class DriveLimits:
    """Limits of a drive: with a position loop travel, speed and acceleration; without one, its torque.

    Attributes:
        travel: from and to [rad] (on a linear axis [m]).
        speed, acceleration: greatest [rad/s], [rad/s^2].
        torque: greatest [N m], of a drive with a torque input; then there are no other limits.

    Raises:
        BadParameter: a limit is missing or has no usable value.
    """

    travel: tuple[float, float] | None = None
    speed: float | None = None
    acceleration: float | None = None
    torque: float | None = None

    def __post_init__(self) -> None:
        """Validate."""
        own = (self.travel, self.speed, self.acceleration)
        if (self.torque is None) == any(limit is None for limit in own) or (self.torque is not None and any(own)):
            raise BadParameter(
                "Limits: give travel, speed and acceleration of a drive with a position loop, or the torque alone of "
                "a drive that takes a torque."
            )
        for name in ("speed", "acceleration", "torque"):
            limit = getattr(self, name)
            if limit is not None and not (np.isfinite(limit) and limit > 0.0):
                raise BadParameter(f"Limits: {name} must be a positive number, not {limit:g}.")
            refuse_huge(f"Limits: {name}", limit or 0.0)
        if self.travel is not None and not (np.isfinite(self.travel).all() and self.travel[0] < self.travel[1]):
            raise BadParameter(
                f"Limits: the travel must go from a lower to a higher angle, not {self.travel[0]:g} to "
                f"{self.travel[1]:g}."
            )


def first_experiment(limits: DriveLimits, *, rate: float = 200.0) -> pd.DataFrame:
    """The recommended first experiment.

    Args:
        limits: of the drive.
        rate: samples per second of the plan; record at this rate or faster.

    Returns:
        Rows of `time` [s], `part` (name of the section), and `setpoint` with its `velocity` and `acceleration`
        [rad, rad/s, rad/s^2], or `torque` [N m].

    Raises:
        BadParameter: a rate that is too low, in general or for the limits.
    """
    import pandas as pd

    if not (np.isfinite(rate) and rate * _REST >= _SAMPLES):
        least = _SAMPLES / _REST
        raise BadParameter(
            f"The rate must be at least {least:g} samples per second, so that a stop can be seen, not {rate:g}."
        )
    if rate > _MOST:
        raise BadParameter(f"The rate must be at most {_MOST:g} samples per second, not {rate:g}.")
    dt = 1.0 / rate
    if limits.torque is not None:
        parts = _torques(limits.torque, dt)
        value = np.concatenate([torque for _, torque in parts])
        columns = {"torque": value}
    else:
        parts = _positions(limits, dt)
        value = np.concatenate([place for _, place in parts])
        velocity = np.gradient(value, dt)
        columns = {"setpoint": value, "velocity": velocity, "acceleration": np.gradient(velocity, dt)}
    names = np.concatenate([np.repeat(name, part.size) for name, part in parts])
    return pd.DataFrame({"time": np.arange(value.size) * dt, "part": names, **columns})


def _torques(limit: float, dt: float) -> list[tuple[str, Array]]:
    top, rest = _ROOM * limit, np.zeros(round(2.0 * _REST / dt))
    stop = min(10.0, _FASTEST / dt)
    grown = signals.chirp(amplitude=1.0, start=0.1, stop=stop, duration=_CHIRP, sample_time=dt)
    levels = tuple(value * top for level in _LEVELS for value in (level, 0.0))
    slow = signals.triangle(amplitude=0.5 * top, frequency=0.1, duration=20.0, sample_time=dt)
    return [
        ("rest", rest),
        ("chirp", 0.5 * top * grown * np.linspace(0.2, 1.0, grown.size)),
        ("rest", rest),
        ("steps", signals.steps(levels=levels, hold=_REST, sample_time=dt)),
        ("slow reversals", slow),
        ("rest", rest),
    ]


def _positions(limits: DriveLimits, dt: float) -> list[tuple[str, Array]]:
    assert limits.travel is not None  # all three, as validated
    assert limits.speed is not None
    assert limits.acceleration is not None
    middle, half = float(np.mean(limits.travel)), _ROOM * 0.5 * (limits.travel[1] - limits.travel[0])
    speed, acceleration = _ROOM * limits.speed, _ROOM * limits.acceleration
    if acceleration * dt > speed:
        raise BadParameter(
            f"At {1.0 / dt:g} samples a second the drive is at full speed after one; plan a higher rate."
        )
    still = np.full(round(_REST / dt), middle)
    steps = [
        (middle + side * min(half, 0.5 * _STROKE * share * speed), share * speed)
        for share in _SPEEDS
        for side in (1.0, -1.0)
    ]
    trajectories = {
        "moves and stops": [(middle + share * half, speed) for share in _MOVES],
        "slow reversals": [
            (middle + side * min(0.5 * half, 0.2 * _STROKE * share * speed), share * speed)
            for share in _SLOW
            for side in (1.0, -1.0, 1.0, -1.0, 0.0)
        ],
        "staircase of speeds": [*steps, (middle, speed)],
    }
    parts = [("rest", still), ("chirp", middle + _chirp(half, speed, acceleration, dt)), ("rest", still)]
    for name, way in trajectories.items():
        place, pieces = middle, []
        for target, pace in way:
            pieces.append(_move(place, target, pace, acceleration, dt))
            place = target
            if name != "slow reversals":
                pieces.append(np.full(round(_REST / dt), place))
        parts += [(name, np.concatenate(pieces)), ("rest", still)]
    return parts


def _chirp(half: float, speed: float, acceleration: float, dt: float) -> Array:
    """A chirp about zero, as wide as travel, speed and acceleration allow at each frequency, from rest to rest."""
    slowest = 0.5 * speed / (2.0 * np.pi * half)
    fastest = np.sqrt(acceleration / (_LEAST * half)) / (2.0 * np.pi)
    fastest = max(min(fastest, _FASTEST / dt), 2.0 * slowest)
    duration = max(_CHIRP, 8.0 / slowest / np.log(fastest / slowest))
    time = np.arange(round(duration / dt)) * dt
    pitch = np.log(fastest / slowest) / duration
    rate = 2.0 * np.pi * slowest * np.exp(pitch * time)
    turns = (rate - rate[0]) / pitch
    wide = 1.0 / (1.0 / half**4 + (rate / speed) ** 4 + (rate**2 / acceleration) ** 4) ** 0.25
    ramp = np.minimum(1.0, np.minimum(time, duration - time) / (0.05 * duration))
    wave = wide * ramp**2 * (3.0 - 2.0 * ramp) * np.sin(turns)
    velocity = np.gradient(wave, dt)
    over = max(
        np.max(np.abs(wave)) / half,
        np.max(np.abs(velocity)) / speed,
        np.max(np.abs(np.gradient(velocity, dt))) / acceleration,
        1.0,
    )
    return np.asarray(wave / over)


def _move(start: float, end: float, speed: float, acceleration: float, dt: float) -> Array:
    """From rest to rest with a trapezoidal velocity; the last sample is at the end."""
    way = abs(end - start)
    if way == 0.0:
        return np.empty(0)
    top = min(speed, np.sqrt(way * acceleration))
    rise, whole = top / acceleration, way / top + top / acceleration
    time = np.arange(1, int(np.ceil(whole / dt)) + 1) * dt
    begun, left = np.minimum(time, rise), np.minimum(np.maximum(whole - time, 0.0), rise)
    even = np.clip(time - rise, 0.0, whole - 2.0 * rise)
    along = 0.5 * acceleration * (begun**2 + rise**2 - left**2) + top * even
    return np.asarray(start + np.sign(end - start) * along)
