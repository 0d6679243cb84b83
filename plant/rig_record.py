"""Where rigs are, and what happened in a run of them."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from plant.encoder import Trail

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class RigState:
    """Where the rig is. Rotor angles are seen from the load: equal to the load's in the middle of the play.

    Attributes:
        angle: load angle [rad].
        velocity: load velocity [rad/s].
        rotor_angles: (m,) of each drive [rad], load side.
        rotor_velocities: (m,) [rad/s], load side.
        least_flank_torques: (m,) least torque of each required flank during the last advance [N m], follower side;
            positive: the teeth pushed in the required sense all the time; zero: they parted; negative: the other
            flank was hit.
        drive_torques: (m,) torque that each motor really gives [N m], load side; by default none.
        trail: past angles, for encoders that lag.
    """

    angle: float
    velocity: float
    rotor_angles: Array
    rotor_velocities: Array
    least_flank_torques: Array
    drive_torques: Array = field(default_factory=lambda: np.zeros(0))
    trail: Trail = ()

    def row(self) -> Array:
        """(1, S) the numbers of `plant.flank.states`."""
        motors = self.drive_torques if self.drive_torques.size else np.zeros(self.rotor_angles.size)
        shafts = (self.rotor_angles, self.rotor_velocities, self.least_flank_torques, motors)
        return np.concatenate(((self.angle, self.velocity), *shafts))[None, :]

    @classmethod
    def of_row(cls, row: Array, trail: Trail = ()) -> RigState:
        """The state of (S,) numbers."""
        rotors, rates, least, drives = row[2:].reshape(4, -1)
        return cls(
            angle=float(row[0]),
            velocity=float(row[1]),
            rotor_angles=rotors,
            rotor_velocities=rates,
            least_flank_torques=least + 0.0,  # no minus zero
            drive_torques=drives,
            trail=trail,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class RigRecord:
    """What happened in a run: T samples, each state at the start of its sample, torques held during it.

    Attributes:
        time: (T,) [s].
        torques: (T, m) pinion torques that the motors were told to give [N m].
        angle: (T,) load angle as the encoder shows it [rad].
        true_angle: (T,) load angle [rad].
        velocity: (T,) load velocity [rad/s].
        motor_angles: (T, m) motor shaft angles as their encoders show them [rad].
        given_torques: (T, m) pinion torques that the motors really gave at the end of the sample [N m].
        flank_torques: (T, m) torque of each required flank at the sample [N m], follower side.
        least_flank_torques: (T, m) the least of it during the sample [N m]; positive: contact was never lost.
        end: state after the last sample.
    """

    time: Array
    torques: Array
    angle: Array
    true_angle: Array
    velocity: Array
    motor_angles: Array
    given_torques: Array
    flank_torques: Array
    least_flank_torques: Array
    end: RigState


@dataclass(frozen=True, kw_only=True, eq=False)
class FleetState:
    """Where B machines are.

    Attributes:
        rows: (B, S) numbers as in `plant.flank.states`.
        trail: past angles, for encoders that lag.
    """

    rows: Array
    trail: Trail = ()

    def machine(self, number: int) -> RigState:
        """The state of one machine."""
        one = slice(number, number + 1)
        return RigState.of_row(self.rows[number], tuple((age, angles[one]) for age, angles in self.trail))


@dataclass(frozen=True, kw_only=True, eq=False)
class FleetRecord:
    """What happened in a run of B machines: as in `RigRecord`, with the machine as the second axis.

    Attributes:
        time: (T,) [s].
        torques, motor_angles, given_torques, flank_torques, least_flank_torques: (T, B, m).
        angle, true_angle, velocity: (T, B).
        end: state after the last sample.
    """

    time: Array
    torques: Array
    angle: Array
    true_angle: Array
    velocity: Array
    motor_angles: Array
    given_torques: Array
    flank_torques: Array
    least_flank_torques: Array
    end: FleetState

    def machine(self, number: int) -> RigRecord:
        """What happened to one machine."""
        names = [each.name for each in fields(self) if each.name not in ("time", "end")]
        own = {name: getattr(self, name)[:, number] for name in names}
        return RigRecord(time=self.time, end=self.end.machine(number), **own)
