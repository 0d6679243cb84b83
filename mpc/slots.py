"""Names for the places of an array that code outside a stage reads or writes: the same in Python and, with the array's
name before them, in C.
"""

from __future__ import annotations

from enum import IntEnum, auto


class _Slot(IntEnum):
    @staticmethod
    def _generate_next_value_(name: str, start: int, count: int, last_values: list[int]) -> int:
        return count


class Tuning(_Slot):
    """By what a controller is tuned."""

    RATE_WEIGHT = auto()  # of a change of torque [rad^2/(N m)^2]
    END = auto()  # P of the horizon's end: angle, both, velocity
    END_BOTH = auto()
    END_VELOCITY = auto()
    INERTIA = auto()
    GREATEST = auto()  # torque on the load in both senses [N m]
    WAVE = auto()  # 2 pi times the bandwidth [1/s]
    ATTAINABLE = auto()  # by how much a path can be bent in a sample [rad]
    TORQUE_STEP = auto()  # greatest change of torque in a sample [N m]
    ASTRAY = auto()  # what a load is off that stands where it should [rad]
    SHARE = auto()  # of a period of the bandwidth a sample is


class Soft(_Slot):
    """Limits of angle and speed, see `mpc.corridor.SoftLimits.numbers`."""

    LOWEST = auto()
    HIGHEST = auto()
    FASTEST = auto()
    FADES = auto()
    WAVE = auto()
    SHOWS = auto()  # angle beyond a limit from which it is reported
    SHOWS_SPEED = auto()


class Rubbing(_Slot):
    """Numbers of friction, see `mpc.friction.friction_numbers`."""

    STANDS = auto()  # speed below which a reference stands [rad/s]
    STD = auto()  # relative standard error of the model's friction
    FADES = auto()  # rate at which what was learnt is forgotten [1/s]
    DEAF = auto()  # innovation that is none while the reference stands [rad]
    MOST_CHANGE = auto()  # of the torque in a sample, what the teeth bear once [N m]
    ARRIVED = auto()  # distance at which a load has arrived [rad]
    GREATEST = auto()  # torque [N m]
    MEMORY = auto()  # samples that the estimate of the disturbance has in common with the one before
    QUIET = auto()  # change of the torque that the teeth bear all the time [N m]
    JERK = auto()  # a quarter of how fast the acceleration of a move may change [rad/s^3]


class Learnt(_Slot):
    """What is remembered of friction, see `mpc.friction.learn`."""

    KNOWN = auto()
    CONSTANT = auto()  # torque besides friction [N m]
    SCALE = auto()  # of the model's friction
    VAR_CONSTANT = auto()  # variances and covariance of both
    COVARIANCE = auto()
    VAR_SCALE = auto()
    SENSE = auto()  # in which friction is compensated
    SLID = auto()  # for how long the load has slid that way [s]
    FOLLOWED = auto()  # its angle as a first-order lag of 1/w follows it [rad]
    VELOCITY = auto()  # of the load [rad/s]
    SHORT = auto()  # whether it is still short of the reference in that sense


class Told(_Slot):
    """A reference that is told one number a sample, see `mpc.preview`."""

    COUNT = auto()  # of the last angles that are known
    FIRST = auto()
    SECOND = auto()
    THIRD = auto()


class Kalman(_Slot):
    """State of the Kalman filter, its first entries."""

    KNOWN = auto()
    DOUBTS = auto()
    DISTURBANCE = auto()
    ANGLE = auto()  # and behind it the rest of the state
    VELOCITY = auto()


class Path(_Slot):
    """The governed reference."""

    GOVERNED = auto()
    ANGLE = auto()
    RATE = auto()
    MOVE = auto()  # acceleration of the move that is under way, see `mpc.governor.hurry`


class Fed(_Slot):
    """What the feed-forward remembers from sample to sample."""

    KNOWN = auto()
    BEND = auto()  # last change of the reference's speed in a sample [rad/s]
    EASED = auto()  # torque that was eased forward in time [N m]
    EASED_CHANGE = auto()
    TORQUE = auto()  # that was fed [N m]
    CHANGE = auto()


class Outcome(_Slot):
    """What a step tells besides torques and angles."""

    MARGIN = auto()
    DISTURBANCE = auto()
    RESIDUAL = auto()


def c_names() -> str:
    """Enumerations of C."""
    return "\n".join(
        f"enum {{ {', '.join(f'{slots.__name__.upper()}_{slot.name} = {slot.value}' for slot in slots)} }};"
        for slots in (Tuning, Soft, Rubbing, Learnt, Told, Kalman, Path, Fed, Outcome)
    )
