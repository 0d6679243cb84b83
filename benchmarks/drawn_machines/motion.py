"""The motion of a drawn machine, sample by sample: midpoint steps, exact stops, commands that switch when they arrive.

Beside what is logged it is written down what each effect was worth in every sample, as a mean torque: the torque that
a model without it would miss. For a spring or a gap between motor and load that is J_motor (x'' - theta'').
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil, exp, pi, sin

import numpy as np
from numpy.typing import NDArray

from drawn_machines.actuator import Actuator, Lag, Values, links_of
from drawn_machines.load import Load, Torque, slide

Array = NDArray[np.float64]
FARTHEST = 2e4 * pi  # [rad]
Law = Callable[[int, float, float], float]  # sample, reading [rad], time [s] -> command held until the next sample


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A servo: rigid body, dead zone, hidden effects by the catalogue's names, and what has no name.

    kp, kd: of a position servo, whose command is a set-point; zero where the command is a torque.
    current_lag, filter_lag: of the current loop and of the measured current [s].
    resonant: share of the arriving torque that swings before it arrives [-], its frequency [rad/s] and damping.
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
        """Share of the inertia on the motor's side of a spring or a gap."""
        for name in ("compliance", "backlash"):
            if name in self.effects:
                return self.effects[name]["motor_share"]
        return 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """What happened, (T,) each: at the samples, or as a mean over the sample that follows.

    command: a torque [N m], or the set-point of a position servo [rad].
    reading: what the encoder shows; current: the filtered torque of the drive [N m]; driving: its mean over the sample.
    error: of the reading, before noise [rad].
    worth: mean torque of each effect, of "rest" and of "dead_zone" over each sample [N m].
    """

    time: Array
    command: Array
    reading: Array
    current: Array
    angle: Array
    velocity: Array
    acceleration: Array
    driving: Array
    error: Array
    worth: Mapping[str, Array]


class RunsAway(ArithmeticError):
    """The load goes where none can: the loop is unstable."""


class Servo:
    """The machine while it moves; it begins at rest, its drive without torque."""

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
        self.current = Lag("measured", lambda torque, speed: torque, time_constant=max(machine.filter_lag, 1e-12))
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
        """One step of length `h` under a command that is held."""
        load, x, v, t, w = self.load, self.x, self.v, self.t, self.w if self.motor else self.v
        middle = t + 0.5 * h
        torque = self.actuator.torque(held, x, v, w, 0.5 * h)
        arriving = self.coupling(self.theta - x, w - v) if self.motor else self._resonant(torque)
        force = arriving + load.passive(x, v, t, 0.0)
        vm, way = slide(v, force, load.dry(v, t, arriving), load.inertia_at(middle), 0.5 * h)
        xm, wm = x + way, w + 0.5 * h * (torque - arriving) / self.motor if self.motor else vm
        torque = self.actuator.play(held, xm, vm, wm, h)
        arriving = self.coupling(self.theta + 0.5 * h * w - xm, wm - vm) if self.motor else self._resonant(torque)
        force = arriving + load.passive(xm, vm, middle, way)
        inertia = load.inertia_at(middle)
        self.v, way_done = slide(v, force, load.dry(vm, middle, arriving), inertia, h)
        dry = (self.v - v) * inertia / h - force
        load.count(xm, vm, middle, way, arriving, dry if load.levels else 0.0, h)
        if load.contact:
            load.bristle = load.slid(way_done)
        if load.change and inertia != load.inertia:
            self.added["payload_change"] -= load.change["inertia"] * (self.v - v)
        if self.motor:
            self.theta, self.w = self.theta + h * wm, w + h * (torque - arriving) / self.motor
            self.added["compliance" if "compliance" in self.effects else "backlash"] += self.motor * (
                (self.v - v) - (self.w - w)
            )
        self._after(torque, h)
        self._sense(x, x + way_done, h)
        self.x, self.t = x + way_done, t + h

    def _resonant(self, torque: float) -> float:
        share = self.machine.resonant[0]
        return torque + share * (self.swing - torque) if share else torque

    def _after(self, torque: float, h: float) -> None:
        """What only follows the torque: the measured current, and what swings before it arrives."""
        self.current.advance(torque, h)
        self.driving += torque * h
        share, frequency, damping = self.machine.resonant
        if share:
            self.added["resonant"] += share * (self.swing - torque) * h
            self.swing_rate += h * (frequency**2 * (torque - self.swing) - 2.0 * damping * frequency * self.swing_rate)
            self.swing += h * self.swing_rate

    def show(self) -> float:
        """What the sensor shows, without noise [rad]."""
        return self._seen(self.x) if self.late is None else self.shown

    def _sense(self, before: float, after: float, h: float) -> None:
        """A sensor that lags goes on by a step in which the load turned evenly."""
        if self.late is not None:
            seen, last = self._seen(after), self._seen(before)
            trail = self.late * (seen - last) / h
            self.shown = seen - trail + (self.shown - last + trail) * exp(-h / self.late)

    def forget(self) -> None:
        """Begin to count anew what each effect is worth."""
        self.driving = 0.0
        for name in self.added:
            self.added[name] = 0.0

    def _seen(self, x: float) -> float:
        disc = self.effects.get("encoder_eccentricity")
        return x + disc["amplitude"] * sin(disc["order"] * x + disc["phase"]) if disc else x


def play(
    machine: Machine, law: Law, times: Array, angle: float, *, noise: Array, count: float, substeps: int
) -> Motion:
    """Move from rest at an angle; `times` (T + 1,) [s] are those of the samples and the end of the last.

    Args:
        machine: what moves.
        law: what commands it, from readings.
        times: as above.
        angle: at the start [rad].
        noise: (T,) of the reading [rad], before it is rounded to `count` [rad].
        count: step of the encoder; 0 for none.
        substeps: steps in a sample.

    Raises `RunsAway`.
    """
    servo = Servo(machine, angle, float(times[0]))
    usual = float(times[-1] - times[0]) / noise.size
    line = Line(machine.effects.get("input_delay", {"time": 0.0})["time"], machine.kp or 1.0)
    rows, worth = np.empty((noise.size, 8)), np.empty((noise.size, len(servo.added)))
    for k in range(noise.size):
        start, end = float(times[k]), float(times[k + 1])
        shown = servo.show()
        reading = shown + float(noise[k])
        reading = count * round(reading / count) if count else reading
        command = law(k, reading, start)
        if k == 0:
            line.acting = command
            servo.actuator.begin(command)
        last, before, current = servo.x, servo.v, servo.current.state
        line.through(servo, command, start, end, usual / substeps)
        length = end - start
        mean = [total / length for total in servo.added.values()]
        rows[k] = (command, reading, current, last, before, (servo.v - before) / length, servo.driving / length, shown)
        worth[k] = mean
        servo.forget()
        if not abs(servo.x) < FARTHEST:
            raise RunsAway
    command, reading, current, x, v, a, driving, shown = rows.T.copy()
    parts = {name: worth[:, place].copy() for place, name in enumerate(servo.added)}
    parts["rest"] = parts["rest"] + parts.pop("resonant")
    return Motion(
        time=times[:-1],
        command=command,
        reading=reading,
        current=current,
        angle=x,
        velocity=v,
        acceleration=a,
        driving=driving,
        error=shown - x,
        worth=parts,
    )


class Line:
    """Commands on their way: each arrives after a time, also inside a sample, where the step is split."""

    def __init__(self, delay: float, gain: float) -> None:
        self.delay, self.gain, self.acting = delay, gain, 0.0
        self.waiting: deque[tuple[float, float]] = deque()

    def through(self, servo: Servo, command: float, start: float, end: float, longest: float) -> None:
        """A sample from `start` to `end` at which a command is given, in steps not longer than `longest`."""
        self.waiting.append((start + self.delay, command))
        now = start
        while now < end:
            while self.waiting and self.waiting[0][0] <= now:
                self.acting = self.waiting.popleft()[1]
            until = min(end, self.waiting[0][0]) if self.waiting else end
            pieces = max(1, ceil((until - now) / longest - 1e-6))
            for _ in range(pieces):
                servo.step(self.acting, (until - now) / pieces)
            if self.delay:
                servo.added["input_delay"] += (self.acting - command) * self.gain * (until - now)
            now = until
        servo.t = end
