"""A servo that hides effects: the machine on which the product is tried, and nothing of the product in its equations.

NumPy alone, a whole batch of machines at once, several fine steps in each sample. Its laws are in `machine_laws`, how
it moves in `machine_motion`, what is played into it in `machine_inputs`; here it is driven and recorded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from machine_inputs import chirp, chirp_and_steps, excitation, load_fluctuation, random_steps, wandering_reference
from machine_laws import DRY, KNOWN, Array, Drivetrain, Effects, Machine
from machine_motion import State, advance
from numpy.typing import ArrayLike

from identification.log import Log, Run

__all__ = [
    "DRY",
    "KNOWN",
    "Array",
    "Drivetrain",
    "Effects",
    "Follower",
    "Loop",
    "Machine",
    "Record",
    "chirp",
    "chirp_and_steps",
    "excitation",
    "load_fluctuation",
    "random_steps",
    "record",
    "wandering_reference",
]
LONGEST_STEP = 0.0025  # fine enough for all that is smooth: after 30 s no angle is off by more than 1e-7 rad [s]
SWING_IN_A_STEP = 0.1  # the fastest swing turns no further in one fine step [rad]


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """What truly happened: (T,) time [s], (T, B) command [N m], angle [rad], velocity [rad/s], measured angle [rad].

    The angle of the motor [rad] is the load's own where no drivetrain lies between them.
    """

    time: Array
    command: Array
    angle: Array
    velocity: Array
    measured: Array
    motor_angle: Array
    reference: Array | None = None

    def log(self, machine: int = 0) -> Log:
        """The log of one machine of the batch, as one run."""
        return Log(runs=(self.run(machine),), axis="rotary")

    def run(self, machine: int = 0, number: int = 0) -> Run:
        return Run(
            label=f"machine {machine} run {number}",
            number=number,
            time=self.time,
            command=self.command[:, machine],
            output=self.measured[:, machine],
            valid=np.ones(self.time.size, dtype=bool),
            servo_gain=np.zeros(self.time.size),
            reference=None if self.reference is None else self.reference,
        )

    def logs(self) -> list[Log]:
        return [self.log(machine) for machine in range(self.command.shape[1])]

    def log_of_runs(self) -> Log:
        """One log of which every machine of the batch is a run: for batches of the same machine."""
        return Log(runs=tuple(self.run(b, number=b) for b in range(self.command.shape[1])), axis="rotary")


@runtime_checkable
class Loop(Protocol):
    """What is closed over the measured angle and makes the torque, to follow a reference (T,) [rad]."""

    @property
    def reference(self) -> Array: ...

    def torque(self, measured: Array, sample_time: float) -> Array:
        """(B,) torque [N m], from the measured angles up to now (k + 1, B) [rad]."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Follower:
    """A PD loop as a drive would close it."""

    reference: Array
    stiffness: float = 80.0
    damping: float = 20.0
    limit: float = 15.0

    def torque(self, measured: Array, sample_time: float) -> Array:
        k = measured.shape[0] - 1
        before = max(k - 4, 0)
        error = self.reference[k] - measured[k]
        rate = (error - self.reference[before] + measured[before]) / (4 * sample_time)
        return np.asarray(np.clip(self.stiffness * error + self.damping * rate, -self.limit, self.limit))


def record(
    machine: Machine,
    command: ArrayLike | Loop,
    *,
    seed: int = 0,
    sample_time: float = 0.005,
    angle: ArrayLike = 0.0,
    velocity: ArrayLike = 0.0,
    noise: float = 1e-3,
    bits: int | None = 17,
    load_torque: ArrayLike = 0.0,
    steps: int = 1,
    begin: float = 0.0,
) -> Record:
    """Drive a batch and record it.

    command: (T,) or (T, B) torque held over each sample [N m], or a `Loop` that makes it.
    noise: standard deviation of the measured angle [rad]; bits: resolution of its encoder.
    load_torque: further torque on the load, (T, B), held over each sample [N m].
    steps: least integration steps in one sample (in each half of a sample that a delay splits); more are taken where it
        is long, and where a drivetrain, a stop or bristles swing faster than these can follow.
    begin: time of the first sample on the machine's clock [s].
    """
    loop = command if isinstance(command, Loop) else None
    given = np.zeros_like(loop.reference) if loop else np.asarray(command, dtype=float)
    given = given[:, None] if given.ndim == 1 else given
    count = given.shape[0]
    extra = np.asarray(load_torque, dtype=float)
    extra = extra[:, None] if extra.ndim == 1 else extra
    extra = np.broadcast_to(extra, (count, extra.shape[1] if extra.ndim == 2 else 1))
    size = np.broadcast_shapes(
        given.shape[1:], extra.shape[1:], np.shape(angle), np.shape(velocity), *machine.shapes
    )[0]  # fmt: skip
    machine = machine.spread(size)
    fastest = max(1.0 / LONGEST_STEP, machine.fastest / SWING_IN_A_STEP)
    steps = max(steps, int(np.ceil(sample_time * fastest - 1e-9)))
    given, extra = np.array(np.broadcast_to(given, (count, size))), np.broadcast_to(extra, (count, size))
    x, v = (np.array(np.broadcast_to(np.asarray(start, dtype=float), (size,))) for start in (angle, velocity))
    shake = noise * np.random.default_rng(seed).standard_normal((count, size))
    delay = np.broadcast_to(np.asarray(machine.get("input_delay", "time"), dtype=float), (size,))
    whole = np.floor(delay / sample_time + 1e-9).astype(int)
    late = np.maximum(delay - whole * sample_time, 0.0)  # until then the older command acts
    columns = np.arange(size)
    state = State.settled(machine, x, v, given[0])
    angles, velocities, measured, motors = (np.empty((count, size)) for _ in range(4))
    for k in range(count):
        angles[k], velocities[k], motors[k] = state.motion[0], state.motion[1], state.motion[-2]
        measured[k] = _encoded(state.seen + shake[k], bits)
        if loop:
            given[k] = loop.torque(measured[: k + 1], sample_time)
        if k == 0:  # the drive has settled at its first command
            state = State.settled(machine, x, v, given[0])
        stretches = [(given[np.maximum(k - whole, 0), columns], sample_time - late)]
        if np.any(late > 0.0):
            stretches.insert(0, (given[np.maximum(k - whole - 1, 0), columns], late))
        now = np.full(size, begin + k * sample_time)
        for torque, length in stretches:
            h = length / steps
            for _ in range(steps):
                state = advance(machine, state, torque, extra[k], now, h)
                now = now + h
    return Record(
        time=begin + np.arange(count) * sample_time,
        command=_measured(given, machine, sample_time),
        angle=angles,
        velocity=velocities,
        measured=measured,
        motor_angle=motors,
        reference=loop.reference if loop else None,
    )


def _measured(torque: Array, machine: Machine, sample_time: float) -> Array:
    """(T, B) what a log shows of a torque that is held over each sample: itself, or behind its measurement's filter."""
    if not (filtered := machine.effects.get("torque_measurement_lag")):
        return torque
    kept, shown = np.exp(-sample_time / filtered["time_constant"]), np.array(torque)
    for k in range(1, len(torque)):
        shown[k] = torque[k - 1] + (shown[k - 1] - torque[k - 1]) * kept
    return shown


def _encoded(angle: Array, bits: int | None) -> Array:
    if bits is None:
        return angle
    count = 2.0 * np.pi / 2**bits
    return np.asarray(np.round(angle / count) * count)
