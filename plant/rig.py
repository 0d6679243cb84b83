"""The rig: a detailed simulation that replaces the machine. It is not the design model.

Motors with their own rotors drive one load through backlash and flanks that can only push; encoders measure load and
motors. The controller and the fits only see its torques and its encoders.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plant.drive_train import DriveTrain
from plant.errors import BadParameter
from plant.flank import DRIVE_PARAMETERS, LOAD_PARAMETERS, REQUIRED_DIRECTION
from plant.fleet import Fleet
from plant.gears import GearTrain
from plant.rig_record import FleetState, RigRecord, RigState

__all__ = ["Rig", "RigRecord", "RigState"]

Array = NDArray[np.float64]

_MAY_BE_NEGATIVE = {"gravity", "gravity_offset", "cogging_amplitude", "cogging_phase", "torque_offset"}
_MUST_BE_POSITIVE = {
    "inertia", "stribeck_velocity", "rotor_inertia", "flank_stiffness", "torque_constant", "winding_resistance",
    "fine_step",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Rig:
    """The drive/anti-drive machine with elastic gear contact and backlash.

    Load:   J x'' = T1 + T2 - alpha cos x - beta sin x - K x' - c x'|x'| + A sin(n x + phi) + offset - dry friction
    Rotor:  Jr_i q_i'' = D_i - T_i - viscous and dry friction of the motor        (referred to the load) Teeth:  T_i
    pushes when |q_i - x| exceeds half the backlash, never pulls      (see `plant.flank.contact_torque`) Motor:  D_i
    follows its command with a lag, within the supply's limits        (see `plant.flank.motor_torque`)

    T1 + T2 is the sum over all drives; D_i is the pinion torque times its gear ratio, without lag if
    `current_bandwidth` is zero. Dry friction holds exactly at rest. Gear stages are rigid: their inertia counts with
    the rotor's. The integration is of first order: halving the step halves the error.

    Attributes:
        gears: the drive train.
        drives: pinion of each motor, 1 or 2, and thus its direction: (1, 2) is the paper's machine, (2,) has one motor,
            (1, 1, 2, 2) two pairs. A drive train of one drive has (1,).
        inertia: load inertia J, without the rotors [kg m^2].
        gravity: alpha [N m].
        gravity_offset: beta [N m].
        viscous_friction: K of the load [N m s/rad].
        coulomb_friction: dry friction of the load [N m].
        breakaway_excess: additional dry friction near rest [N m].
        stribeck_velocity: velocity over which that excess decays [rad/s].
        quadratic_drag: c [N m s^2/rad^2].
        cogging_amplitude, cogging_order, cogging_phase: A [N m], n [periods per turn], phi [rad].
        torque_offset: constant torque on the load [N m].
        rotor_inertia: of each rotor, at the motor shaft [kg m^2].
        motor_viscous, motor_coulomb: friction of each motor, at its shaft [N m s/rad], [N m].
        torque_constant, winding_resistance: of each motor [N m/A, which is V s/rad], [ohm]; used with a supply.
        supply_voltage: [V]; limits torque and speed; 0 for no limit.
        current_bandwidth: of the current loop [Hz]; 0 for no lag.
        backlash: of each final mesh, at the load, from flank to flank [rad]; a number, or one per drive.
        flank_stiffness, flank_damping: of teeth in contact, at the load [N m/rad], [N m s/rad].
        mesh_friction: dry friction of each gear per transmitted torque, acting on its motor [-].
        encoder_counts: counts per turn of the load's encoder; 0 for no quantisation.
        encoder_noise: standard deviation before quantisation [rad].
        motor_encoder_counts: counts per turn of the motors' encoders; 0 for no quantisation.
        motor_encoder_noise: standard deviation at the motor shaft before quantisation [rad].
        encoder_delay: delay of all encoders [s].
        fine_step: longest integration step [s].

    Raises:
        BadParameter: a number that is not finite or out of range, or a step too long for the stiffness.
    """

    gears: DriveTrain
    drives: tuple[int, ...] = (1, 2)
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
    torque_constant: float = 36.0 / (2000.0 * 2.0 * np.pi / 60.0)
    winding_resistance: float = 20.0
    supply_voltage: float = 0.0
    current_bandwidth: float = 0.0
    backlash: float | tuple[float, ...] = 1.2e-3
    flank_stiffness: float = 2e4
    flank_damping: float = 6.0
    mesh_friction: float = 0.0
    encoder_counts: int = 2**17
    encoder_noise: float = 2e-5
    motor_encoder_counts: int = 4096
    motor_encoder_noise: float = 0.0
    encoder_delay: float = 0.0
    fine_step: float = 20e-6

    def __post_init__(self) -> None:
        """Check every number, and that the fine step resolves the fastest vibration."""
        pinions = range(1, self.gears.drives + 1)
        if not self.drives or any(isinstance(d, bool) or d not in pinions for d in self.drives):
            named = " or ".join(map(str, pinions))
            raise BadParameter(f"Rig: drives must name pinion {named} for each motor, not {self.drives!r}.")
        if np.shape(self.backlash) not in ((), (len(self.drives),)):
            raise BadParameter(f"Rig: backlash must be a number or one for each drive, not {self.backlash!r}.")
        for field in fields(self)[2:]:
            for value in np.ravel(getattr(self, field.name)):
                if not np.isfinite(value):
                    raise BadParameter(f"Rig: {field.name} must be a finite number, not {value!r}.")
                if value < 0 and field.name not in _MAY_BE_NEGATIVE:
                    raise BadParameter(f"Rig: {field.name} must not be negative, but is {value:g}.")
                if value == 0 and field.name in _MUST_BE_POSITIVE:
                    raise BadParameter(f"Rig: {field.name} must be above zero.")
        lightest = min(self.inertia, float(np.min(self.rotor_inertias)))
        fastest = 1.0 / np.sqrt(self.flank_stiffness / lightest) / 8.0
        damping = max(self.flank_damping, float(np.max(self.emf_damping)))
        longest = min(fastest, lightest / (4.0 * damping)) if damping else fastest
        if self.fine_step > longest:
            raise BadParameter(
                f"Rig: fine_step = {self.fine_step:g} s is too long for teeth this stiff; use at most {longest:.2g} s."
            )

    @classmethod
    def paper_like(cls, **changes: Any) -> Rig:
        """J = 2, alpha = 0.5, K = 0.8, the paper's gears, 4 arcmin of backlash, small motors; `changes` replace fields.

        With `supply_voltage=36` the motors' no-load speed is the paper's 2000 rpm; their winding resistance and inertia
        are not in the paper.
        """
        paper = {"inertia": 2.0, "gravity": 0.5, "viscous_friction": 0.8}
        return cls(gears=GearTrain.paper(), **{**paper, **changes})

    @cached_property
    def _pinions(self) -> list[int]:
        return [drive - 1 for drive in self.drives]

    @cached_property
    def motor_ratios(self) -> Array:
        """(m,) turns of each motor for one turn of the load."""
        return self.gears.motor_ratios[self._pinions]

    @cached_property
    def torque_map(self) -> Array:
        """(m,) output torque for one newton metre on each pinion."""
        return self.gears.torque_map[self._pinions]

    @cached_property
    def directions(self) -> Array:
        """(m,) required sign of each drive's output torque."""
        return np.array(REQUIRED_DIRECTION)[self._pinions]

    @property
    def rotor_inertias(self) -> Array:
        """(m,) rotor inertias seen from the load [kg m^2]."""
        return self.rotor_inertia * self.motor_ratios**2

    @property
    def emf_damping(self) -> Array:
        """(m,) decrease of a motor's largest torque with speed at a given voltage, referred to the load [N m s/rad]."""
        limited = self.supply_voltage > 0.0
        return limited * (self.torque_constant * self.motor_ratios) ** 2 / self.winding_resistance

    @property
    def half_backlash(self) -> Array:
        """(m,) half the backlash [rad]."""
        return np.broadcast_to(np.asarray(self.backlash, dtype=np.float64) / 2, (len(self.drives),))

    @cached_property
    def _alone(self) -> Fleet:
        return Fleet((self,))

    @property
    def total_inertia(self) -> float:
        """Inertia of the load with all rotors in mesh [kg m^2]: what a rigid model of the rig should find."""
        return self.inertia + float(np.sum(self.rotor_inertias))

    @cached_property
    def stall_torques(self) -> Array:
        """(m,) largest torque of each motor at standstill, referred to the load [N m]; infinite without a supply."""
        if self.supply_voltage == 0.0:
            return np.full(len(self.drives), np.inf)
        return self.motor_ratios * self.torque_constant * self.supply_voltage / self.winding_resistance

    @cached_property
    def parameters(self) -> Array:
        """(P,) parameters of `plant.flank.fine_steps`."""
        ratios, bandwidth = self.motor_ratios, self.current_bandwidth
        of_load = {name: getattr(self, name) for name in LOAD_PARAMETERS if hasattr(self, name)}
        of_load["current_lag"] = 1.0 / (2.0 * np.pi * bandwidth) if bandwidth else 0.0
        of_drives = {
            "direction": self.directions,
            "rotor_inertia": self.rotor_inertias,
            "rotor_viscous": self.motor_viscous * ratios**2,
            "rotor_coulomb": self.motor_coulomb * ratios,
            "half_backlash": self.half_backlash,
            "stall_torque": self.stall_torques,
            "emf_damping": self.emf_damping,
        }
        rows = np.array([of_drives[name] for name in DRIVE_PARAMETERS])
        return np.concatenate(([of_load[name] for name in LOAD_PARAMETERS], rows.T.ravel()))

    def rest(self, angle: float = 0.0, torques: ArrayLike = 0.0) -> RigState:
        """At rest at a load angle [rad], each rotor on its required flank.

        The flanks are compressed by pinion torques (m,) [N m] of the required signs [+ -].
        """
        drives = self.torque_map * np.broadcast_to(np.asarray(torques, dtype=np.float64), (len(self.drives),))
        pressed = np.maximum(self.directions * drives, 0.0)
        return RigState(
            angle=float(angle),
            velocity=0.0,
            rotor_angles=angle + self.directions * (self.half_backlash + pressed / self.flank_stiffness),
            rotor_velocities=np.zeros(len(self.drives)),
            minimum_contact_torques=pressed,
            drive_torques=drives,
        )

    def advance(self, state: RigState, torques: ArrayLike, duration: float, disturbance: float = 0.0) -> RigState:
        """The state after pinion torques (m,) and a load disturbance torque [N m] have been held for `duration` [s].

        Raises:
            BadParameter: a torque or the duration is not a usable number.
        """
        one = FleetState(rows=state.row(), trail=state.trail)
        return self._alone.advance(one, np.asarray(torques, dtype=np.float64)[None], duration, disturbance).machine(0)

    def contact_torques(self, state: RigState) -> Array:
        """(m,) torque of each required flank [N m], output side; positive: pushing in the required direction."""
        found: Array = self._alone.contact_torques(FleetState(rows=state.row()))[0]
        return found

    def energy(self, state: RigState) -> float:
        """Kinetic energy, potential energy of gravity and elastic energy of the flanks [J]."""
        pressed = np.maximum(np.abs(state.rotor_angles - state.angle) - self.half_backlash, 0.0)
        kinetic = self.inertia * state.velocity**2 + float(self.rotor_inertias @ state.rotor_velocities**2)
        height = self.gravity * np.sin(state.angle) - self.gravity_offset * np.cos(state.angle)
        return float(0.5 * kinetic + height + 0.5 * self.flank_stiffness * float(pressed @ pressed))

    def measure(self, state: RigState, rng: np.random.Generator) -> float:
        """The load angle measured by its encoder [rad]."""
        one = FleetState(rows=state.row(), trail=state.trail)
        return float(self._alone.measure(one, rng.standard_normal())[0])

    def motor_angles(self, state: RigState, rng: np.random.Generator | None = None) -> Array:
        """(m,) motor shaft angles measured by their encoders [rad]; without noise if no generator is given."""
        one = FleetState(rows=state.row(), trail=state.trail)
        noise = 0.0 if rng is None else rng.standard_normal((1, len(self.drives)))
        shown: Array = self._alone.motor_angles(one, noise)[0]
        return shown

    def run(
        self,
        torques: ArrayLike,
        sample_time: float,
        seed: int,
        *,
        start: RigState | None = None,
        disturbance: ArrayLike = 0.0,
    ) -> RigRecord:
        """Simulate pinion torques (T, m) [N m], each row held for `sample_time` [s], and record.

        Args:
            torques: (T, m) pinion torques [N m].
            sample_time: [s].
            seed: of the encoder's noise.
            start: first state; at rest at angle zero by default.
            disturbance: torque on the load [N m], a number or (T,).

        Raises:
            BadParameter: the torques have another shape, or a number is not finite.
        """
        commands, count = np.asarray(torques, dtype=np.float64), len(self.drives)
        if commands.ndim != 2 or commands.shape[1] != count or not np.all(np.isfinite(commands)):
            raise BadParameter(f"Rig: the torques must be finite and of shape (T, {count}), not {commands.shape}.")
        first = None if start is None else FleetState(rows=start.row(), trail=start.trail)
        pushes = np.broadcast_to(np.asarray(disturbance, dtype=np.float64), commands.shape[:1])[:, None]
        return self._alone.run(commands[:, None], sample_time, [seed], start=first, disturbance=pushes).machine(0)
