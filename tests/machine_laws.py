"""The laws of a servo that hides effects: what each part does to the torque on its way, to the load and to the reading.

    command -> (delay) -> (rate limit) -> (first-order lag) -> (saturation) -> (- back-emf) -> (dead zone h)
            -> tau_load, or the motor of a drivetrain that transmits tau_load
    position servo: goal -> (delay) -> (goal rate limit) -> clip(gain (goal - x), -limit, limit) -> (saturation) -> ...
    J x'' = -alpha cos x - K x' + tau_load + tau_added - friction
    reading = x + eccentricity -> (first-order lag) -> noise -> encoder
    recorded torque = command -> (first-order lag of its measurement)

NumPy alone and nothing of the product; every effect by the name and the parameter names of the catalogue.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Effects = Mapping[str, Mapping[str, ArrayLike]]

KNOWN = {
    "input_delay": ("time",),
    "actuator_lag": ("time_constant",),
    "dead_zone": ("half_width",),
    "torque_offset": ("torque",),
    "coulomb_friction": ("torque",),
    "asymmetric_friction": ("forward", "backward", "viscous_difference"),
    "stribeck_friction": ("coulomb", "excess", "velocity"),
    "quadratic_drag": ("drag",),
    "gravity_offset": ("beta",),
    "cogging": ("amplitude", "order", "phase"),
    "torque_saturation": ("limit",),
    "rate_limit": ("rate",),
    "setpoint_rate_limit": ("rate",),
    "back_emf": ("constant",),
    "compliance": ("frequency", "damping", "motor_share"),
    "backlash": ("gap", "motor_share"),
    "load_dependent_friction": ("coefficient",),
    "presliding_hysteresis": ("torque", "stiffness"),
    "cable_stiffness": ("stiffness", "cubic", "rest_angle"),
    "end_stop": ("angle", "stiffness"),
    "payload_change": ("time", "inertia", "gravity"),
    "periodic_disturbance": ("amplitude", "frequency", "phase"),
    "friction_drift": ("viscous_rate", "coulomb_rate"),
    "encoder_eccentricity": ("amplitude", "order", "phase"),
    "sensor_lag": ("time_constant",),
    "torque_measurement_lag": ("time_constant",),
}
DRY = {
    "coulomb_friction",
    "asymmetric_friction",
    "stribeck_friction",
    "load_dependent_friction",
    "presliding_hysteresis",
    "friction_drift",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Drivetrain:
    """Motor and load with a spring and a damper between them, and free play if `gap` is given."""

    motor_inertia: Array
    load_inertia: Array
    frequency: Array
    stiffness: Array
    damping: Array
    gap: Array | None

    @staticmethod
    def of(
        inertia: ArrayLike, motor_share: ArrayLike, frequency: ArrayLike, damping: ArrayLike, gap: ArrayLike | None
    ) -> Drivetrain:
        """The inertia divided, with the spring and the damper that swing so while both ends are free."""
        whole, share, swing = (np.asarray(given, dtype=float) for given in (inertia, motor_share, frequency))
        motor, load = share * whole, (1.0 - share) * whole
        reduced = motor * load / whole
        return Drivetrain(
            motor_inertia=motor,
            load_inertia=load,
            frequency=swing,
            stiffness=swing**2 * reduced,
            damping=2.0 * np.asarray(damping) * swing * reduced,
            gap=None if gap is None else np.asarray(gap, dtype=float),
        )

    def transmitted(self, twist: Array, twist_rate: Array) -> Array:
        """Torque from motor to load [N m]; `twist` is the lead of the motor. A flank only pushes."""
        if self.gap is None:
            return self.stiffness * twist + self.damping * twist_rate
        side = np.sign(twist)
        depth = np.abs(twist) - self.gap / 2.0
        push = np.maximum(self.stiffness * depth + self.damping * side * twist_rate, 0.0)
        return np.asarray(np.where(depth > 0.0, side * push, 0.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Machine:
    """One machine, or a batch of B when a number is given as (B,); the paper's with a dead zone by default.

    With a servo gain [N m/rad] it is a position servo: its command is a goal [rad], and the drive gives no more than
    `command_limit` [N m]. On the spring of a tooth flank both masses swing at `flank_frequency` [rad/s], with a damping
    ratio of `flank_damping`.
    """

    inertia: ArrayLike = 2.0
    gravity: ArrayLike = 0.5
    viscous_friction: ArrayLike = 0.8
    effects: Effects = field(default_factory=lambda: {"dead_zone": {"half_width": 0.5}})
    servo_gain: ArrayLike = 0.0
    command_limit: ArrayLike = np.inf
    payload: ArrayLike = 0.0  # 1 once a payload change has happened
    flank_frequency: ArrayLike = 400.0
    flank_damping: ArrayLike = 0.5

    def __post_init__(self) -> None:
        for name, values in self.effects.items():
            if set(values) != set(KNOWN[name]):
                raise ValueError(f"{name} takes {KNOWN[name]}, not {tuple(values)}")
        if {"compliance", "backlash"} <= set(self.effects):
            raise ValueError("a machine has one drivetrain: compliance or backlash, not both")
        if self.is_servo and {"rate_limit", "actuator_lag"} & set(self.effects):
            raise ValueError("a position servo's torque follows its angle at once: no rate limit, no lag")
        if not self.is_servo and "setpoint_rate_limit" in self.effects:
            raise ValueError("a goal has a position servo only: give a servo gain")

    def hiding(self, **effects: Mapping[str, ArrayLike]) -> Machine:
        """The same machine with more effects."""
        return replace(self, effects={**self.effects, **effects})

    def carrying(self, changed: ArrayLike) -> Machine:
        """The same machine before (0) or after (1) its payload has changed."""
        return replace(self, payload=changed)

    def spread(self, size: int) -> Machine:
        """The same batch with every number as (B,)."""
        return self.pick(np.ones(size, dtype=bool), size)

    def pick(self, rows: NDArray[np.bool_], size: int) -> Machine:
        """Some machines of a batch."""

        def some(value: ArrayLike) -> Array:
            return np.broadcast_to(np.asarray(value, dtype=float), (size,))[rows]

        return Machine(
            inertia=some(self.inertia),
            gravity=some(self.gravity),
            viscous_friction=some(self.viscous_friction),
            effects={name: {p: some(v) for p, v in values.items()} for name, values in self.effects.items()},
            servo_gain=some(self.servo_gain),
            command_limit=some(self.command_limit),
            payload=some(self.payload),
            flank_frequency=some(self.flank_frequency),
            flank_damping=some(self.flank_damping),
        )

    @property
    def shapes(self) -> list[tuple[int, ...]]:
        """Of all its numbers."""
        numbers = [self.inertia, self.gravity, self.viscous_friction, self.servo_gain, self.command_limit]
        return [np.shape(n) for n in (*numbers, *(v for values in self.effects.values() for v in values.values()))]

    def get(self, effect: str, parameter: str, absent: float = 0.0) -> ArrayLike:
        return self.effects[effect][parameter] if effect in self.effects else absent

    @cached_property
    def is_servo(self) -> bool:
        """Whether its command is a goal [rad] and not a torque."""
        return bool(np.all(np.asarray(self.servo_gain) > 0.0))

    # How the mass is divided.

    @cached_property
    def drivetrain(self) -> Drivetrain | None:
        if p := self.effects.get("compliance"):
            return Drivetrain.of(self.inertia, p["motor_share"], p["frequency"], p["damping"], None)
        if p := self.effects.get("backlash"):
            return Drivetrain.of(self.inertia, p["motor_share"], self.flank_frequency, self.flank_damping, p["gap"])
        return None

    @cached_property
    def load_inertia(self) -> ArrayLike:
        """What a torque on the load accelerates: behind a drivetrain its part, always with the payload."""
        bare = self.drivetrain.load_inertia if self.drivetrain else self.inertia
        if p := self.effects.get("payload_change"):
            return bare + np.asarray(self.payload) * p["inertia"]
        return bare

    @property
    def fastest(self) -> float:
        """The fastest swing that fine steps have to follow [rad/s]: of a drivetrain, at a stop, on the bristles."""
        swings: list[ArrayLike] = [0.0]
        if self.drivetrain:
            swings.append(self.drivetrain.frequency)
        if p := self.effects.get("end_stop"):
            swings.append(np.sqrt(np.abs(p["stiffness"]) / self.load_inertia))
        if p := self.effects.get("presliding_hysteresis"):
            swings.append(np.sqrt(2.0 * np.asarray(p["stiffness"]) / self.load_inertia))
        return max(float(np.max(swing)) for swing in swings)

    # The torque on its way to the load.

    def amplified(self, torque: Array) -> Array:
        """Torque [N m] behind saturation and dead zone; where a back-emf comes between, `turned` has the dead zone."""
        if p := self.effects.get("torque_saturation"):
            torque = np.minimum(np.maximum(torque, -np.asarray(p["limit"])), p["limit"])
        return torque if "back_emf" in self.effects else self.behind_dead_zone(torque)

    @property
    def corners(self) -> list[Array]:
        """Torques [N m] at which saturation and dead zone bend."""
        saturated = self.effects.get("torque_saturation", {}).get("limit")
        half_width = None if "back_emf" in self.effects else self.effects.get("dead_zone", {}).get("half_width")
        kinks = [np.asarray(kink, dtype=float) for kink in (saturated, half_width) if kink is not None]
        return [side * kink for kink in kinks for side in (-1.0, 1.0)]

    def delivered(self, torque: Array, x: Array, v: Array) -> Array:
        """Of a drive at an angle and a speed [N m]; to a position servo the torque is a goal still [rad]."""
        if self.is_servo:
            pull = np.asarray(self.servo_gain) * (torque - x)
            torque = self.amplified(np.minimum(np.maximum(pull, -np.asarray(self.command_limit)), self.command_limit))
        return self.turned(torque, v)

    def turned(self, torque: Array, v: Array) -> Array:
        """What the back-emf of a load that turns leaves of an amplified torque [N m]."""
        if p := self.effects.get("back_emf"):
            return self.behind_dead_zone(torque - p["constant"] * v)
        return torque

    def behind_dead_zone(self, torque: Array) -> Array:
        if p := self.effects.get("dead_zone"):
            return np.sign(torque) * np.maximum(np.abs(torque) - p["half_width"], 0.0)
        return torque

    def biased(self, torque: ArrayLike) -> ArrayLike:
        """With the drive's own bias, which no dead zone swallows."""
        if p := self.effects.get("torque_offset"):
            return torque + np.asarray(p["torque"])
        return torque

    # What acts on the load.

    def pull(self, x: Array, v: Array, torque: Array, time: ArrayLike = 0.0) -> Array:
        """All torque on the load but dry friction [N m]; `torque` has passed the actuator, or else the drivetrain."""
        gravity = self.gravity
        if p := self.effects.get("payload_change"):
            gravity = gravity + np.asarray(self.payload) * p["gravity"]
        total = torque - gravity * np.cos(x) - self.viscous_friction * v
        if not self.drivetrain:
            total = np.asarray(self.biased(total))
        if p := self.effects.get("asymmetric_friction"):
            total = total - p["viscous_difference"] * np.abs(v)
        if p := self.effects.get("quadratic_drag"):
            total = total - p["drag"] * v * np.abs(v)
        if p := self.effects.get("gravity_offset"):
            total = total - p["beta"] * np.sin(x)
        if p := self.effects.get("cogging"):
            total = total + p["amplitude"] * np.sin(p["order"] * x + p["phase"])
        if p := self.effects.get("cable_stiffness"):
            deflection = x - p["rest_angle"]
            total = total - p["stiffness"] * deflection - p["cubic"] * deflection**3
        if p := self.effects.get("end_stop"):
            stiffness = np.asarray(p["stiffness"])  # below zero: a stop at the lower end
            total = total - stiffness * np.maximum(np.sign(stiffness) * (x - p["angle"]), 0.0)
        if p := self.effects.get("periodic_disturbance"):
            total = total + p["amplitude"] * np.sin(2.0 * np.pi * p["frequency"] * time + p["phase"])
        if p := self.effects.get("friction_drift"):
            total = total - p["viscous_rate"] * time * v
        return total

    @cached_property
    def slides(self) -> bool:
        """Whether friction of some kind can hold it."""
        return bool(DRY & set(self.effects))

    def dry(self, v: Array, direction: Array, torque: ArrayLike = 0.0, time: ArrayLike = 0.0) -> Array:
        """Size of dry friction when the load moves, or is about to, in a direction (+1, -1) [N m]."""
        size = np.asarray(self.get("coulomb_friction", "torque"))
        if p := self.effects.get("asymmetric_friction"):
            size = size + np.where(direction > 0, p["forward"], p["backward"])
        if p := self.effects.get("stribeck_friction"):
            size = size + p["coulomb"] + p["excess"] * np.exp(-((v / p["velocity"]) ** 2))
        if p := self.effects.get("load_dependent_friction"):
            arriving = torque if self.drivetrain else self.biased(torque)
            size = size + p["coefficient"] * np.abs(arriving)
        if p := self.effects.get("friction_drift"):
            size = size + np.maximum(p["coulomb_rate"] * np.asarray(time), 0.0)
        return size

    def bristle(self, before: Array, travel: Array, way: Array) -> Array:
        """Dahl's friction torque [N m] after a travel in one direction, from its value before.

        dF/dx = stiffness (1 - F sgn(v) / torque), in closed form as long as the load does not turn back.
        """
        if p := self.effects.get("presliding_hysteresis"):
            final = way * p["torque"]
            return final + (before - final) * np.exp(-way * travel * p["stiffness"] / p["torque"])
        return before

    # What the sensor makes of it.

    def reading(self, x: Array) -> Array:
        """Angle that an ideal counter reads off the encoder's disc [rad]."""
        if p := self.effects.get("encoder_eccentricity"):
            return x + p["amplitude"] * np.sin(p["order"] * x + p["phase"])
        return x
