"""Names of array elements that are accessed outside a stage: the same in Python and, with the name of the array as a
prefix, in C.
"""

from __future__ import annotations

from enum import IntEnum, auto


class _Slot(IntEnum):
    @staticmethod
    def _generate_next_value_(name: str, start: int, count: int, last_values: list[int]) -> int:
        return count


class Tuning(_Slot):
    """Tuning parameters of a controller."""

    RATE_WEIGHT = auto()  # weight of a change of torque [rad^2/(N m)^2]
    END = auto()  # terminal weight P: of the angle, of the product angle times velocity, of the velocity
    END_BOTH = auto()
    END_VELOCITY = auto()
    INERTIA = auto()
    GREATEST = auto()  # torque on the load that is reached in both directions [N m]
    WAVE = auto()  # 2 pi times the bandwidth [1/s]
    ATTAINABLE = auto()  # greatest second difference of the angle that the torques can give in a sample [rad]
    TORQUE_STEP = auto()  # greatest change of torque in a sample [N m]
    FOLLOWING_ERROR = auto()  # permitted following error at constant speed [rad]
    SHARE = auto()  # sample time in units of a period of the bandwidth


class Soft(_Slot):
    """Limits of angle and speed, see `mpc.soft_limits.SoftLimits.numbers`."""

    LOWEST = auto()
    HIGHEST = auto()
    FASTEST = auto()
    FADES = auto()
    WAVE = auto()
    SHOWS = auto()  # violation of an angle limit from which it is reported
    SHOWS_SPEED = auto()


class Rubbing(_Slot):
    """Numbers of friction, see `mpc.friction.friction_numbers`."""

    STILL = auto()  # speed below which a reference counts as standing still [rad/s]
    STD = auto()  # relative standard error of the model's friction
    FADES = auto()  # forgetting rate of the adaptation [1/s]
    DEAF = auto()  # dead band of the innovation while the reference stands still [rad]
    MOST_CHANGE = auto()  # greatest single change of the torque in a sample that the contact tolerates [N m]
    ARRIVED = auto()  # distance at which a load has reached its target [rad]
    GREATEST = auto()  # greatest torque [N m]
    MEMORY = auto()  # correlation time of the disturbance estimate [samples]
    QUIET = auto()  # permanent change of the torque per sample that the contact tolerates [N m]
    JERK = auto()  # a quarter of the greatest rate of the acceleration of a move [rad/s^3]


class Learnt(_Slot):
    """Memory of the adaptation of friction, see `mpc.friction.learn`."""

    KNOWN = auto()
    CONSTANT = auto()  # unmodelled constant torque besides friction [N m]
    SCALE = auto()  # factor on the model's friction
    VAR_CONSTANT = auto()  # variances and covariance of both
    COVARIANCE = auto()
    VAR_SCALE = auto()
    DIRECTION = auto()  # direction in which friction is compensated, 0: none
    SLID = auto()  # time for which the load has slid in that direction [s]
    FOLLOWED = auto()  # load angle filtered by a first-order lag of 1/w [rad]
    VELOCITY = auto()  # of the load [rad/s]
    SHORT = auto()  # whether the load has not yet reached the reference in that direction


class History(_Slot):
    """Memory of a reference given as one number per sample, see `mpc.preview`."""

    COUNT = auto()  # number of known last angles
    FIRST = auto()
    SECOND = auto()
    THIRD = auto()


class Kalman(_Slot):
    """State of the Kalman filter, its first entries."""

    KNOWN = auto()
    REJECTED = auto()
    DISTURBANCE = auto()
    ANGLE = auto()  # followed by the rest of the state
    VELOCITY = auto()


class Path(_Slot):
    """The governed reference."""

    GOVERNED = auto()
    ANGLE = auto()
    RATE = auto()
    MOVE = auto()  # acceleration of the present move, see `mpc.time_optimal_law.hurry`


class Fed(_Slot):
    """Memory of the feedforward."""

    KNOWN = auto()
    VELOCITY_CHANGE = auto()  # last change of the reference's speed in a sample [rad/s]
    EASED = auto()  # required torque, smoothed forward in time [N m]
    EASED_CHANGE = auto()
    TORQUE = auto()  # last feedforward torque [N m]
    CHANGE = auto()


class Outcome(_Slot):
    """Results of a step besides torques and angles."""

    MARGIN = auto()
    DISTURBANCE = auto()
    RESIDUAL = auto()


def c_names() -> str:
    """The same names as C enumerations."""
    return "\n".join(
        f"enum {{ {', '.join(f'{slots.__name__.upper()}_{slot.name} = {slot.value}' for slot in slots)} }};"
        for slots in (Tuning, Soft, Rubbing, Learnt, History, Kalman, Path, Fed, Outcome)
    )
