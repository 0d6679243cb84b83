"""Simulation of a drawn machine, step by step: classical Runge-Kutta, with stops of the load at their instant.

In every step the torque of each effect is recorded, as the torque that a model without it would lack. For a compliance
or a backlash between motor and load that is J_motor (x'' - theta'').
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, exp, sin

from drawn_machines.actuator import Actuator, Lag, Values, links_of
from drawn_machines.load import Load, Torque, slide

State = tuple[float, float, float, float]  # angle and velocity of the load, and of a separate motor


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A servo: rigid body, dead zone, hidden effects by the catalogue's names, and unmodelled torque.

    Attributes:
        kp, kd: of a position servo, whose command is a set-point; zero where the command is a torque.
        current_lag, filter_lag: of the current loop and of the measured current [s].
        resonant: share of the torque that passes a resonance [-], its frequency [rad/s] and damping.
    """

    inertia: float
    gravity: float
    viscous_friction: float
    dead_zone: float = 0.0
    effects: Mapping[str, Values]
    rest: Torque | None = None
    resonant: tuple[float, float, float] = (0.0, 1.0, 1.0)
    kp: float = 0.0
    kd: float = 0.0
    current_lag: float = 0.0
    filter_lag: float = 0.0

    @property
    def motor_share(self) -> float:
        """Share of the inertia on the motor's side of a compliance or a backlash."""
        for name in ("compliance", "backlash"):
            if name in self.effects:
                return self.effects[name]["motor_share"]
        return 0.0


class Servo:
    """The simulated machine; it starts at rest, with zero torque of the drive."""

    def __init__(self, machine: Machine, angle: float, time: float) -> None:
        self.machine, self.effects = machine, machine.effects
        share = machine.motor_share
        self.motor = share * machine.inertia
        self.actuator = Actuator(*links_of(machine.effects, machine.dead_zone, machine.current_lag))
        self.actuator.kp, self.actuator.kd = machine.kp, machine.kd
        self.load = Load(
            machine.inertia - self.motor, machine.gravity, machine.viscous_friction, machine.effects, machine.rest
        )
        names = [*machine.effects, *(link.name for link in self.actuator.behind), "rest", "resonant"]
        self.added = dict.fromkeys(names, 0.0)
        self.actuator.added = self.load.added = self.added
        self.t, self.x, self.v = time, angle, 0.0
        self.theta, self.w = angle, 0.0
        self.swing = self.swing_rate = 0.0
        self.current = Lag("measured", time_constant=max(machine.filter_lag, 1e-12))
        self.late = machine.effects.get("sensor_lag", {}).get("time_constant")
        self.shown = self._seen(angle)
        self.driving = 0.0

    def coupling(self, twist: float, rate: float) -> float:
        """Torque from motor to load [N m]."""
        spring = self.effects.get("compliance")
        reduced = self.machine.motor_share * (1.0 - self.machine.motor_share) * self.machine.inertia
        if spring:
            w = spring["frequency"]
            return reduced * w * (w * twist + 2.0 * spring["damping"] * rate)
        gap = self.effects["backlash"]
        w, damping = gap["flank_frequency"], gap["flank_damping"]
        beyond = abs(twist) - 0.5 * gap["gap"]
        if beyond <= 0.0:
            return 0.0
        side = 1.0 if twist > 0.0 else -1.0
        return side * reduced * w**2 * max(beyond + 2.0 * damping / w * rate * side, 0.0)

    def step(self, held: float, h: float) -> None:
        """One step of length `h` under a held command: sliding, or to a stop and on from there."""
        x, v, w = self.x, self.v, self.w
        speed = w if self.motor else v
        torque = self.actuator.follow(held, x + 0.5 * h * v, v, speed, h)
        after, force = self._sliding(h)
        if self.load.levels and (v == 0.0 or after[1] * v <= 0.0):
            after, force = self._stopping(h)
        self._count(after, force, torque, h)
        self.x, self.v, self.theta, self.w = after
        self.t += h

    def _forces(self, part: int, at: State, travel: float, t: float) -> tuple[float, float, float]:
        """Smooth force on the load, torque at the load, and acceleration of the motor if there is one."""
        x, v, theta, w = at
        if not self.motor:
            arriving = self._resonant(self.actuator.torque(part, x, v, v))
            return arriving + self.load.passive(x, v, t, travel), arriving, 0.0
        torque = self.actuator.torque(part, x, v, w)
        arriving = self.coupling(theta - x, w - v)
        return arriving + self.load.passive(x, v, t, travel), arriving, (torque - arriving) / self.motor

    def _sliding(self, h: float) -> tuple[State, float]:
        """The state after a step in which the load does not stop, and the mean smooth force on it."""
        start = (self.x, self.v, self.theta, self.w)
        inertia = self.load.inertia_at(self.t + 0.5 * h)
        slopes: list[State] = []
        whole = 0.0
        for part, share, weight in ((0, 0.0, 1.0), (1, 0.5, 2.0), (1, 0.5, 2.0), (2, 1.0, 1.0)):
            x, v, theta, w = start
            if slopes:
                dx, dv, dtheta, dw = slopes[-1]
                x, v, theta, w = x + share * h * dx, v + share * h * dv, theta + share * h * dtheta, w + share * h * dw
            t = self.t + share * h
            force, arriving, turning = self._forces(part, (x, v, theta, w), x - self.x, t)
            whole += weight * force
            if self.load.levels and self.v != 0.0:
                forward, backward = self.load.dry(v, t, arriving)
                force -= forward if self.v > 0.0 else -backward
            slopes.append((v, force / inertia, w, turning))
        one, two, three, four = slopes
        x, v, theta, w = (
            s + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
            for s, a, b, c, d in zip(start, one, two, three, four, strict=True)
        )
        return (x, v, theta, w), whole / 6.0

    def _stopping(self, h: float) -> tuple[State, float]:
        """The same if the load stops or rests: with the force in the middle of the step."""
        load, x, v, theta, w = self.load, self.x, self.v, self.theta, self.w
        middle = self.t + 0.5 * h
        force, arriving, turning = self._forces(0, (x, v, theta, w), 0.0, self.t)
        vm, way = slide(v, force, load.dry(v, self.t, arriving), load.inertia_at(middle), 0.5 * h)
        wm = w + 0.5 * h * turning
        at = (x + way, vm, theta + 0.5 * h * w, wm)
        force, arriving, turning = self._forces(1, at, way, middle)
        after, way = slide(v, force, load.dry(vm, middle, arriving), load.inertia_at(middle), h)
        return (x + way, after, theta + h * wm, w + h * turning), force

    def _count(self, after: State, force: float, torque: float, h: float) -> None:
        """Record the torque of each effect in the step, and advance the states that follow the motion."""
        load, x, v = self.load, self.x, self.v
        middle, way = self.t + 0.5 * h, after[0] - x
        xm, vm = 0.5 * (x + after[0]) - 0.125 * h * (after[1] - v), way / h
        inertia = load.inertia_at(middle)
        dry = (after[1] - v) * inertia / h - force if load.levels else 0.0
        arriving = torque
        if self.motor:
            arriving = self.coupling(0.5 * (self.theta + after[2]) - xm, 0.5 * (self.w + after[3]) - vm)
            name = "compliance" if "compliance" in self.effects else "backlash"
            self.added[name] += self.motor * ((after[1] - v) - (after[3] - self.w))
        load.count(xm, vm, middle, xm - x, arriving, dry, h)
        if load.contact:
            load.bristle = load.slid(way)
        if load.change and inertia != load.inertia:
            self.added["payload_change"] -= load.change["inertia"] * (after[1] - v)
        self._after(torque, h)
        self._sense(after, h)

    def _resonant(self, torque: float) -> float:
        share = self.machine.resonant[0]
        return torque + share * (self.swing - torque) if share else torque

    def _after(self, torque: float, h: float) -> None:
        """Advance the states that follow the torque: measured current and resonance."""
        self.current.follow(torque, h)
        self.driving += torque * h
        share, frequency, damping = self.machine.resonant
        if share:
            self.added["resonant"] += share * (self.swing - torque) * h
            self.swing_rate += h * (frequency**2 * (torque - self.swing) - 2.0 * damping * frequency * self.swing_rate)
            self.swing += h * self.swing_rate

    def show(self) -> float:
        """Measurement of the sensor, without noise [rad]."""
        return self._seen(self.x) if self.late is None else self.shown

    def _sense(self, after: State, h: float) -> None:
        """Advance a sensor with lag by a step of constant acceleration of the load."""
        if self.late is None:
            return
        (seen, rate), (last, before) = self._seen_rate(after[0], after[1]), self._seen_rate(self.x, self.v)
        curvature = self.late**2 * (rate - before) / h
        start = self.shown - (last - self.late * before + curvature)
        self.shown = seen - self.late * rate + curvature + start * exp(-h / self.late)

    def _seen_rate(self, x: float, v: float) -> tuple[float, float]:
        """Measured angle of the encoder disc at an angle, and its rate."""
        disc = self.effects.get("encoder_eccentricity")
        return self._seen(x), v * (
            1.0 + disc["amplitude"] * disc["order"] * cos(disc["order"] * x + disc["phase"])
        ) if disc else v

    def forget(self) -> None:
        """Reset the recorded torques of the effects."""
        self.driving = 0.0
        for name in self.added:
            self.added[name] = 0.0

    def _seen(self, x: float) -> float:
        disc = self.effects.get("encoder_eccentricity")
        return x + disc["amplitude"] * sin(disc["order"] * x + disc["phase"]) if disc else x
