"""The motion of a drawn machine, sample by sample: measurements, delayed commands, and the logged signals."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil, inf, pi

import numpy as np
from numpy.typing import NDArray

from drawn_machines.servo import Machine, Servo

Array = NDArray[np.float64]
FARTHEST = 2e4 * pi  # [rad]
Law = Callable[[int, float, float], float]  # sample, measurement [rad], time [s] -> command held until the next sample


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Signals of a simulation, (T,) each: at the samples, or as a mean over the following sample.

    Attributes:
        command: a torque [N m], or the set-point of a position servo [rad].
        reading: measurement of the encoder [rad].
        current: the filtered torque of the drive [N m].
        driving: the drive's mean torque over the sample [N m].
        error: of the measurement, before noise [rad].
        torques: mean torque of each effect, of "rest" and of "dead_zone" over each sample [N m].
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
    torques: Mapping[str, Array]


class RunsAway(ArithmeticError):
    """The load diverges: the loop is unstable."""


def play(
    machine: Machine, law: Law, times: Array, angle: float, *, noise: Array, count: float, substeps: int
) -> Motion:
    """Simulate from rest at an angle; `times` (T + 1,) [s] are those of the samples and the end of the last one.

    Args:
        machine: the machine.
        law: its commands, from measurements.
        times: as above.
        angle: at the start [rad].
        noise: (T,) of the measurement [rad], before it is rounded to `count` [rad].
        count: step of the encoder; 0 for none.
        substeps: integration steps in a sample.

    Raises:
        RunsAway: the load diverges.
    """
    servo = Servo(machine, angle, float(times[0]))
    usual = float(times[-1] - times[0]) / noise.size
    effects = machine.effects
    line = Line(
        effects.get("input_delay", {"time": 0.0})["time"],
        machine.kp or 1.0,
        effects.get("payload_change", {"time": inf})["time"],
    )
    rows, torques = np.empty((noise.size, 8)), np.empty((noise.size, len(servo.added)))
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
        torques[k] = mean
        servo.forget()
        if not abs(servo.x) < FARTHEST:
            raise RunsAway
    command, reading, current, x, v, a, driving, shown = rows.T.copy()
    parts = {name: torques[:, place].copy() for place, name in enumerate(servo.added)}
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
        torques=parts,
    )


class Line:
    """Delayed commands: each arrives after a dead time, also within a sample, where the step is split.

    Attributes:
        change: instant of a payload change [s], where the step is split too.
    """

    def __init__(self, delay: float, gain: float, change: float) -> None:
        self.delay, self.gain, self.change, self.acting = delay, gain, change, 0.0
        self.waiting: deque[tuple[float, float]] = deque()

    def through(self, servo: Servo, command: float, start: float, end: float, longest: float) -> None:
        """Simulate a sample from `start` to `end`, with its new command, in steps not longer than `longest`."""
        self.waiting.append((start + self.delay, command))
        now = start
        while now < end:
            while self.waiting and self.waiting[0][0] <= now:
                self.acting = self.waiting.popleft()[1]
            until = min(end, self.waiting[0][0]) if self.waiting else end
            if now < self.change < until:
                until = self.change
            pieces = max(1, ceil((until - now) / longest - 1e-6))
            for _ in range(pieces):
                servo.step(self.acting, (until - now) / pieces)
            if self.delay:
                servo.added["input_delay"] += (self.acting - command) * self.gain * (until - now)
            now = until
        servo.t = end
