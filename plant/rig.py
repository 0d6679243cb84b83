"""The rig: the machine in place of the machine. It is not the design model.

Two motors with rotors of their own drive one load through tooth gaps and flanks that can only push; an encoder looks at
the load. The controller and the fits only ever see its torques and its encoder.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plant.errors import BadParameter
from plant.flank import BLOCK, PARAMETERS, REQUIRED_SENSE, advance_function
from plant.gears import GearTrain

Array = NDArray[np.float64]

_MAY_BE_NEGATIVE = {"gravity", "gravity_offset", "cogging_amplitude", "cogging_phase", "torque_offset"}
_MUST_BE_POSITIVE = {"inertia", "stribeck_velocity", "rotor_inertia", "flank_stiffness", "fine_step"}


@dataclass(frozen=True, kw_only=True, eq=False)
class RigState:
    """Where the rig is. Rotor angles are seen from the load: equal to the load's in the middle of the play.

    Attributes:
        angle: load angle [rad].
        velocity: load velocity [rad/s].
        rotor_angles: (2,) [rad], load side.
        rotor_velocities: (2,) [rad/s], load side.
        least_flank_torques: (2,) least torque of each required flank during the last advance [N m], follower side;
            positive: the teeth pushed in the required sense all the time; zero: they parted; negative: the other
            flank was hit.
    """

    angle: float
    velocity: float
    rotor_angles: Array
    rotor_velocities: Array
    least_flank_torques: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class RigRecord:
    """What happened in a run: T samples, each state at the start of its sample, torques held during it.

    Attributes:
        time: (T,) [s].
        torques: (T, 2) pinion torques [N m].
        angle: (T,) load angle as the encoder shows it [rad].
        true_angle: (T,) load angle [rad].
        velocity: (T,) load velocity [rad/s].
        motor_angles: (T, 2) motor shaft angles [rad].
        flank_torques: (T, 2) torque of each required flank at the sample [N m], follower side.
        least_flank_torques: (T, 2) the least of it during the sample [N m]; positive: the teeth never parted.
        end: state after the last sample.
    """

    time: Array
    torques: Array
    angle: Array
    true_angle: Array
    velocity: Array
    motor_angles: Array
    flank_torques: Array
    least_flank_torques: Array
    end: RigState


@dataclass(frozen=True, kw_only=True)
class Rig:
    """The drive/anti-drive machine with elastic, free teeth.

    Load:   J x'' = T1 + T2 - alpha cos x - beta sin x - K x' - c x'|x'| + A sin(n x + phi) + offset - dry friction
    Rotor:  Jr_i q_i'' = D_i - T_i - viscous and dry friction of the motor        (seen from the load)
    Teeth:  T_i pushes when |q_i - x| exceeds half the play, and never pulls      (see `plant.flank.flank_torque`)

    D_i is the pinion torque times its gear ratio. Dry friction holds exactly at rest.

    Attributes:
        gears: the gear train.
        inertia: load inertia J, without the rotors [kg m^2].
        gravity: alpha [N m].
        gravity_offset: beta [N m].
        viscous_friction: K of the load [N m s/rad].
        coulomb_friction: dry friction of the load [N m].
        breakaway_excess: by how much it is higher near rest [N m].
        stribeck_velocity: velocity over which that excess fades [rad/s].
        quadratic_drag: c [N m s^2/rad^2].
        cogging_amplitude, cogging_order, cogging_phase: A [N m], n [periods per turn], phi [rad].
        torque_offset: constant torque on the load [N m].
        rotor_inertia: of each rotor, at the motor shaft [kg m^2].
        motor_viscous, motor_coulomb: friction of each motor, at its shaft [N m s/rad], [N m].
        backlash: free play of each final mesh, seen at the load, from flank to flank [rad].
        flank_stiffness, flank_damping: of teeth in contact, seen at the load [N m/rad], [N m s/rad].
        encoder_counts: counts per turn of the load's encoder; 0 reads without steps.
        encoder_noise: standard deviation before counting [rad].
        motor_encoder_counts: counts per turn of the motors' encoders; 0 reads without steps.
        fine_step: longest integration step [s].

    Raises:
        BadParameter: a number that is not finite or out of range, or a step too long for the stiffness.
    """

    gears: GearTrain
    inertia: float
    gravity: float = 0.0
    gravity_offset: float = 0.0
    viscous_friction: float = 0.0
    coulomb_friction: float = 0.0
    breakaway_excess: float = 0.0
    stribeck_velocity: float = 0.05
    quadratic_drag: float = 0.0
    cogging_amplitude: float = 0.0
    cogging_order: float = 0.0
    cogging_phase: float = 0.0
    torque_offset: float = 0.0
    rotor_inertia: float = 4e-6
    motor_viscous: float = 1e-7
    motor_coulomb: float = 5e-4
    backlash: float = 1.2e-3
    flank_stiffness: float = 2e4
    flank_damping: float = 6.0
    encoder_counts: int = 2**17
    encoder_noise: float = 2e-5
    motor_encoder_counts: int = 4096
    fine_step: float = 20e-6

    def __post_init__(self) -> None:
        """Check every number, and that the fine step resolves the stiffest vibration."""
        for field in fields(self)[1:]:
            value = getattr(self, field.name)
            if not np.isfinite(value):
                raise BadParameter(f"Rig: {field.name} must be a finite number, not {value!r}.")
            if value < 0 and field.name not in _MAY_BE_NEGATIVE:
                raise BadParameter(f"Rig: {field.name} must not be negative, but is {value:g}.")
            if value == 0 and field.name in _MUST_BE_POSITIVE:
                raise BadParameter(f"Rig: {field.name} must be above zero.")
        lightest = min(self.inertia, float(np.min(self._rotor_inertias)))
        fastest = 1.0 / np.sqrt(self.flank_stiffness / lightest) / 8.0
        longest = min(fastest, lightest / (4.0 * self.flank_damping)) if self.flank_damping else fastest
        if self.fine_step > longest:
            raise BadParameter(
                f"Rig: fine_step = {self.fine_step:g} s is too long for teeth this stiff; use at most {longest:.2g} s."
            )

    @classmethod
    def paper_like(cls, **changes: float) -> Rig:
        """J = 2, alpha = 0.5, K = 0.8, the paper's gears, 4 arcmin of play, small motors; `changes` replace fields."""
        paper = {"inertia": 2.0, "gravity": 0.5, "viscous_friction": 0.8}
        return cls(gears=GearTrain.paper(), **{**paper, **changes})  # type: ignore[arg-type]

    @property
    def _rotor_inertias(self) -> Array:
        """(2,) rotor inertias seen from the load [kg m^2]."""
        return self.rotor_inertia * self.gears.motor_ratios**2

    @property
    def total_inertia(self) -> float:
        """Inertia of the load with both rotors in mesh [kg m^2]: what a rigid model of the rig should find."""
        return self.inertia + float(np.sum(self._rotor_inertias))

    @cached_property
    def _parameters(self) -> Array:
        ratios = self.gears.motor_ratios
        values = {name: getattr(self, name) for name in PARAMETERS if hasattr(self, name)}
        values["half_play"] = self.backlash / 2
        for i in range(2):
            values[f"rotor_inertia_{i + 1}"] = self._rotor_inertias[i]
            values[f"rotor_viscous_{i + 1}"] = self.motor_viscous * ratios[i] ** 2
            values[f"rotor_coulomb_{i + 1}"] = self.motor_coulomb * ratios[i]
        return np.array([values[name] for name in PARAMETERS])

    def rest(self, angle: float = 0.0, torques: ArrayLike = (0.0, 0.0)) -> RigState:
        """At rest at a load angle [rad], each rotor on the flank that its drive must keep.

        The teeth are pressed as far as pinion torques (2,) [N m] of the required senses [+ -] press them.
        """
        drives = self.gears.torque_map * np.asarray(torques, dtype=np.float64)
        sense = np.array(REQUIRED_SENSE)
        pressed = np.maximum(sense * drives, 0.0)
        return RigState(
            angle=float(angle),
            velocity=0.0,
            rotor_angles=angle + sense * (self.backlash / 2 + pressed / self.flank_stiffness),
            rotor_velocities=np.zeros(2),
            least_flank_torques=pressed,
        )

    def advance(self, state: RigState, torques: ArrayLike, duration: float, disturbance: float = 0.0) -> RigState:
        """The state after pinion torques (2,) [N m] and a disturbing load torque [N m] were held for `duration` [s].

        Raises:
            BadParameter: a torque or the duration is not a usable number.
        """
        pinion = np.asarray(torques, dtype=np.float64)
        if pinion.shape != (2,) or not np.all(np.isfinite(pinion)) or not np.isfinite(disturbance):
            raise BadParameter(f"Rig: the torques must be two finite numbers [N m], not {torques!r}.")
        if not 0.0 < duration < np.inf:
            raise BadParameter(f"Rig: the duration must be above zero and finite, not {duration!r} s.")
        blocks = max(1, int(np.ceil(duration / (self.fine_step * BLOCK) - 1e-9)))
        begin = np.concatenate(
            ((state.angle, state.velocity), state.rotor_angles, state.rotor_velocities, (np.inf, np.inf))
        )
        drives = self.gears.torque_map * pinion
        end = advance_function(blocks)(begin, drives, disturbance, duration / (blocks * BLOCK), self._parameters)
        z = np.asarray(end, dtype=np.float64)[:, 0]
        return RigState(
            angle=float(z[0]),
            velocity=float(z[1]),
            rotor_angles=z[2:4],
            rotor_velocities=z[4:6],
            least_flank_torques=z[6:8] + 0.0,  # no minus zero
        )

    def flank_torques(self, state: RigState) -> Array:
        """(2,) torque of each required flank [N m], follower side; positive: pushing in the required sense."""
        gap, rate = state.rotor_angles - state.angle, state.rotor_velocities - state.velocity
        pressed = np.maximum(np.abs(gap) - self.backlash / 2, 0.0)
        push = self.flank_stiffness * pressed + self.flank_damping * np.sign(gap) * rate
        passed = np.sign(gap) * np.where(pressed > 0.0, np.maximum(push, 0.0), 0.0)
        return np.asarray(np.array(REQUIRED_SENSE) * passed)

    def energy(self, state: RigState) -> float:
        """Kinetic energy, potential energy of gravity and energy of the pressed teeth [J]."""
        pressed = np.maximum(np.abs(state.rotor_angles - state.angle) - self.backlash / 2, 0.0)
        kinetic = self.inertia * state.velocity**2 + float(self._rotor_inertias @ state.rotor_velocities**2)
        height = self.gravity * np.sin(state.angle) - self.gravity_offset * np.cos(state.angle)
        return float(0.5 * kinetic + height + 0.5 * self.flank_stiffness * float(pressed @ pressed))

    def measure(self, state: RigState, rng: np.random.Generator) -> float:
        """The load angle as its encoder shows it [rad]."""
        return float(_counted(state.angle + self.encoder_noise * rng.standard_normal(), self.encoder_counts))

    def motor_angles(self, state: RigState) -> Array:
        """(2,) motor shaft angles as their encoders show them [rad]."""
        turned = self.gears.pre_reduction * self.gears.angle_map * state.rotor_angles
        return _counted(turned, self.motor_encoder_counts)

    def run(
        self,
        torques: ArrayLike,
        sample_time: float,
        seed: int,
        *,
        start: RigState | None = None,
        disturbance: ArrayLike = 0.0,
    ) -> RigRecord:
        """Play pinion torques (T, 2) [N m], each row held for `sample_time` [s], and record.

        Args:
            torques: (T, 2) pinion torques [N m].
            sample_time: [s].
            seed: of the encoder's noise.
            start: first state; at rest at angle zero by default.
            disturbance: torque on the load [N m], a number or (T,).

        Raises:
            BadParameter: the torques have another shape, or a number is not finite.
        """
        commands = np.asarray(torques, dtype=np.float64)
        if commands.ndim != 2 or commands.shape[1] != 2 or not np.all(np.isfinite(commands)):
            raise BadParameter(f"Rig: the torques must be finite and of shape (T, 2), not of shape {commands.shape}.")
        pushes = np.broadcast_to(np.asarray(disturbance, dtype=np.float64), commands.shape[:1])
        rng = np.random.default_rng(seed)
        state = self.rest() if start is None else start
        states, measured = [state], []
        for command, push in zip(commands, pushes, strict=True):
            measured.append(self.measure(state, rng))
            state = self.advance(state, command, sample_time, float(push))
            states.append(state)
        samples = states[:-1]
        count = len(samples)
        return RigRecord(
            time=np.arange(count, dtype=np.float64) * sample_time,
            torques=commands.copy(),
            angle=np.array(measured),
            true_angle=np.array([s.angle for s in samples]),
            velocity=np.array([s.velocity for s in samples]),
            motor_angles=np.array([self.motor_angles(s) for s in samples]).reshape(count, 2),
            flank_torques=np.array([self.flank_torques(s) for s in samples]).reshape(count, 2),
            least_flank_torques=np.array([s.least_flank_torques for s in states[1:]]).reshape(count, 2),
            end=states[-1],
        )


def _counted(angle: ArrayLike, counts: int) -> Array:
    """The angle in whole counts of an encoder, shape of the input; unchanged without counts."""
    exact = np.asarray(angle, dtype=np.float64)
    if counts == 0:
        return exact
    resolution = 2 * np.pi / counts
    return np.asarray(np.round(exact / resolution) * resolution)
