"""States of rigs, and records of their runs."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from plant.encoder import Trail
from plant.renamed import Renamed
from plant.result_display import Drawn

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class RigState:
    """State of the rig. Rotor angles are referred to the load: equal to its angle in the middle of the backlash.

    Attributes:
        angle: load angle [rad].
        velocity: load velocity [rad/s].
        rotor_angles: (m,) of each drive [rad], load side.
        rotor_velocities: (m,) [rad/s], load side.
        minimum_contact_torques: (m,) least torque of each required flank during the last advance [N m], output side;
            positive: in contact all the time; zero: loss of contact; negative: contact on the other flank.
        drive_torques: (m,) actual torque of each motor [N m], load side; by default empty.
        trail: past angles, for encoders with delay.
    """

    angle: float
    velocity: float
    rotor_angles: Array
    rotor_velocities: Array
    minimum_contact_torques: Array
    drive_torques: Array = field(default_factory=lambda: np.zeros(0))
    trail: Trail = ()

    least_flank_torques = Renamed("minimum_contact_torques")

    def row(self) -> Array:
        """(1, S) the state as in `plant.flank.states`."""
        motors = self.drive_torques if self.drive_torques.size else np.zeros(self.rotor_angles.size)
        shafts = (self.rotor_angles, self.rotor_velocities, self.minimum_contact_torques, motors)
        return np.concatenate(((self.angle, self.velocity), *shafts))[None, :]

    @classmethod
    def of_row(cls, row: Array, trail: Trail = ()) -> RigState:
        """The state from (S,) numbers."""
        rotors, rates, least, drives = row[2:].reshape(4, -1)
        return cls(
            angle=float(row[0]),
            velocity=float(row[1]),
            rotor_angles=rotors,
            rotor_velocities=rates,
            minimum_contact_torques=least + 0.0,  # no minus zero
            drive_torques=drives,
            trail=trail,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class RigRecord(Drawn):
    """Record of a run: T samples, each state at the start of its sample, torques held during it.

    Attributes:
        time: (T,) [s].
        torques: (T, m) commanded pinion torques of the motors [N m].
        angle: (T,) load angle measured by the encoder [rad].
        true_angle: (T,) load angle [rad].
        velocity: (T,) load velocity [rad/s].
        motor_angles: (T, m) motor shaft angles measured by their encoders [rad].
        given_torques: (T, m) actual pinion torques of the motors at the end of the sample [N m].
        contact_torques: (T, m) torque of each required flank at the sample [N m], output side.
        minimum_contact_torques: (T, m) the least of it during the sample [N m]; positive: contact was never lost.
        end: state after the last sample.
    """

    time: Array
    torques: Array
    angle: Array
    true_angle: Array
    velocity: Array
    motor_angles: Array
    given_torques: Array
    contact_torques: Array
    minimum_contact_torques: Array
    end: RigState

    def __repr__(self) -> str:
        """Length and minimum contact torque in one line."""
        least = float(np.min(self.minimum_contact_torques, initial=np.inf))
        return f"RigRecord({self.time.size} samples, minimum contact torque {least:.4g} N m)"


@dataclass(frozen=True, kw_only=True, eq=False)
class FleetState:
    """State of B machines.

    Attributes:
        rows: (B, S) numbers as in `plant.flank.states`.
        trail: past angles, for encoders with delay.
    """

    rows: Array
    trail: Trail = ()

    def machine(self, number: int) -> RigState:
        """The state of one machine."""
        one = slice(number, number + 1)
        return RigState.of_row(self.rows[number], tuple((age, angles[one]) for age, angles in self.trail))


@dataclass(frozen=True, kw_only=True, eq=False)
class FleetRecord:
    """Record of a run of B machines: as `RigRecord`, with the machine as the second axis.

    Attributes:
        time: (T,) [s].
        torques, motor_angles, given_torques, contact_torques, minimum_contact_torques: (T, B, m).
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
    contact_torques: Array
    minimum_contact_torques: Array
    end: FleetState

    def machine(self, number: int) -> RigRecord:
        """The record of one machine."""
        names = [each.name for each in fields(self) if each.name not in ("time", "end")]
        own = {name: getattr(self, name)[:, number] for name in names}
        return RigRecord(time=self.time, end=self.end.machine(number), **own)
