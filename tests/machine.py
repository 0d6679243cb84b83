"""A servo that hides effects: the machine on which the product is tried, and nothing of the product in its equations.

NumPy alone, a whole batch of machines at once, several Runge-Kutta steps in each sample, and dry friction located in
time: a load that stops inside a step stops exactly there, and holds or breaks away. The laws are

    J x'' = -alpha cos x - K x' + tau_load + tau_added - friction
    command -> (delay) -> (first-order lag) -> (dead zone h) -> tau_load

with every effect by the name and the parameter names of the catalogue, so that a test can ask for what it has hidden.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identification.log import Log, Run

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
}
DRY = {"coulomb_friction", "asymmetric_friction", "stribeck_friction"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Machine:
    """One machine, or a batch of B when a number is given as (B,); the paper's with a dead zone by default."""

    inertia: ArrayLike = 2.0
    gravity: ArrayLike = 0.5
    viscous_friction: ArrayLike = 0.8
    effects: Effects = field(default_factory=lambda: {"dead_zone": {"half_width": 0.5}})

    def __post_init__(self) -> None:
        for name, values in self.effects.items():
            if set(values) != set(KNOWN[name]):
                raise ValueError(f"{name} takes {KNOWN[name]}, not {tuple(values)}")

    def hiding(self, **effects: Mapping[str, ArrayLike]) -> Machine:
        """The same machine with more effects."""
        return Machine(
            inertia=self.inertia,
            gravity=self.gravity,
            viscous_friction=self.viscous_friction,
            effects={**self.effects, **effects},
        )

    @property
    def slides(self) -> bool:
        return bool(DRY & set(self.effects))

    def get(self, effect: str, parameter: str, absent: float = 0.0) -> ArrayLike:
        return self.effects[effect][parameter] if effect in self.effects else absent

    def behind_dead_zone(self, torque: Array) -> Array:
        if "dead_zone" not in self.effects:
            return torque
        gamma = np.asarray(self.get("dead_zone", "half_width"))
        return np.sign(torque) * np.maximum(np.abs(torque) - gamma, 0.0)

    def pull(self, x: Array, v: Array, torque: Array) -> Array:
        """All torque on the load but dry friction [N m]; `torque` has passed the actuator."""
        total = torque - self.gravity * np.cos(x) - self.viscous_friction * v
        if "torque_offset" in self.effects:
            total = total + self.get("torque_offset", "torque")
        if "asymmetric_friction" in self.effects:
            total = total - self.get("asymmetric_friction", "viscous_difference") * np.abs(v)
        if "quadratic_drag" in self.effects:
            total = total - self.get("quadratic_drag", "drag") * v * np.abs(v)
        if "gravity_offset" in self.effects:
            total = total - self.get("gravity_offset", "beta") * np.sin(x)
        if "cogging" in self.effects:
            order, phase = self.get("cogging", "order"), self.get("cogging", "phase")
            total = total + self.get("cogging", "amplitude") * np.sin(order * x + phase)
        return total

    def dry(self, v: Array, direction: Array) -> Array:
        """Size of dry friction when the load moves, or is about to, in a direction (+1, -1) [N m]."""
        size = np.zeros_like(v) + self.get("coulomb_friction", "torque")
        if "asymmetric_friction" in self.effects:
            ahead, back = (self.get("asymmetric_friction", side) for side in ("forward", "backward"))
            size = size + np.where(direction > 0, ahead, back)
        if "stribeck_friction" in self.effects:
            level, excess = self.get("stribeck_friction", "coulomb"), self.get("stribeck_friction", "excess")
            size = size + level + excess * np.exp(-((v / self.get("stribeck_friction", "velocity")) ** 2))
        return size

    def pick(self, rows: NDArray[np.bool_], size: int) -> Machine:
        """Some machines of a batch."""

        def some(value: ArrayLike) -> ArrayLike:
            return np.broadcast_to(np.asarray(value, dtype=float), (size,))[rows]

        return Machine(
            inertia=some(self.inertia),
            gravity=some(self.gravity),
            viscous_friction=some(self.viscous_friction),
            effects={name: {p: some(v) for p, v in values.items()} for name, values in self.effects.items()},
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """What truly happened: (T,) time [s], (T, B) command [N m], angle [rad], velocity [rad/s], measured angle [rad]."""

    time: Array
    command: Array
    angle: Array
    velocity: Array
    measured: Array
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Follower:
    """A PD loop around a reference (T,) [rad], closed over the measured angle as a drive would."""

    reference: Array
    stiffness: float = 80.0
    damping: float = 20.0
    limit: float = 15.0


def record(
    machine: Machine,
    command: ArrayLike | Follower,
    *,
    seed: int = 0,
    sample_time: float = 0.005,
    angle: ArrayLike = 0.0,
    velocity: ArrayLike = 0.0,
    noise: float = 1e-3,
    bits: int | None = 17,
    load_torque: ArrayLike = 0.0,
    steps: int = 4,
) -> Record:
    """Drive a batch and record it.

    command: (T,) or (T, B) torque held over each sample [N m], or a `Follower` that makes it.
    noise: standard deviation of the measured angle [rad]; bits: resolution of its encoder.
    load_torque: further torque on the load, (T, B), held over each sample [N m].
    steps: integration steps in one sample (in each half of a sample that a delay splits).
    """
    loop = command if isinstance(command, Follower) else None
    given = np.zeros_like(loop.reference) if loop else np.asarray(command, dtype=float)
    given = given[:, None] if given.ndim == 1 else given
    count = given.shape[0]
    extra = np.asarray(load_torque, dtype=float)
    extra = extra[:, None] if extra.ndim == 1 else extra
    extra = np.broadcast_to(extra, (count, extra.shape[1] if extra.ndim == 2 else 1))
    size = np.broadcast_shapes(
        given.shape[1:], extra.shape[1:], np.shape(angle), np.shape(velocity), np.shape(machine.inertia),
        np.shape(machine.gravity), np.shape(machine.viscous_friction),
        *(np.shape(v) for values in machine.effects.values() for v in values.values()),
    )[0]  # fmt: skip
    given = np.array(np.broadcast_to(given, (count, size)))
    x, v = (np.array(np.broadcast_to(np.asarray(start, dtype=float), (size,))) for start in (angle, velocity))
    shake = noise * np.random.default_rng(seed).standard_normal((count, size))
    delay = np.broadcast_to(np.asarray(machine.get("input_delay", "time"), dtype=float), (size,))
    whole = np.floor(delay / sample_time + 1e-9).astype(int)
    late = np.maximum(delay - whole * sample_time, 0.0)  # until then the older command acts
    columns = np.arange(size)
    lagged = None
    angles, velocities, measured = (np.empty((count, size)) for _ in range(3))
    for k in range(count):
        angles[k], velocities[k] = x, v
        measured[k] = _encoded(x + shake[k], bits)
        if loop:
            before = max(k - 4, 0)
            error = loop.reference[k] - measured[k]
            rate = (error - loop.reference[before] + measured[before]) / (4 * sample_time)
            torque = loop.stiffness * error + loop.damping * rate
            given[k] = np.clip(torque, -loop.limit, loop.limit)
        if lagged is None:
            lagged = given[0].copy()
        stretches = [(given[np.maximum(k - whole, 0), columns], sample_time - late)]
        if np.any(late > 0.0):
            stretches.insert(0, (given[np.maximum(k - whole - 1, 0), columns], late))
        for torque, length in stretches:
            h = np.broadcast_to(length / steps, (size,))
            for _ in range(steps):
                x, v, lagged = _advance(machine, x, v, lagged, torque, extra[k], h)
    reference = loop.reference if loop else None
    time = np.arange(count) * sample_time
    return Record(time=time, command=given, angle=angles, velocity=velocities, measured=measured, reference=reference)


def _encoded(angle: Array, bits: int | None) -> Array:
    if bits is None:
        return angle
    count = 2.0 * np.pi / 2**bits
    return np.asarray(np.round(angle / count) * count)


def _advance(
    machine: Machine, x: Array, v: Array, lagged: Array, torque: Array, extra: Array, h: Array
) -> tuple[Array, Array, Array]:
    """One fine step under a constant command."""
    if "actuator_lag" in machine.effects:
        fade = np.exp(-h / 2.0 / np.asarray(machine.get("actuator_lag", "time_constant")))
        middle = torque + (lagged - torque) * fade
        end = torque + (lagged - torque) * fade**2
        drive = [machine.behind_dead_zone(t) + extra for t in (lagged, middle, end)]
    else:
        end = torque
        drive = [machine.behind_dead_zone(torque) + extra] * 3
    if not machine.slides:
        x, v = _runge_kutta(machine, x, v, drive, h, None)
        return x, v, end

    way = _way(machine, x, v, drive[0])
    new_x, new_v = _runge_kutta(machine, x, v, drive, h, way)
    new_x, new_v = np.where(way == 0, x, new_x), np.where(way == 0, 0.0, new_v)
    turns = new_v * way < 0
    if turns.any():
        drive = [np.broadcast_to(d, x.shape)[turns] for d in drive]
        new_x[turns], new_v[turns] = _through_rest(
            machine.pick(turns, x.size), x[turns], v[turns], new_v[turns], drive, h[turns], way[turns]
        )
    return new_x, new_v, end


def _way(machine: Machine, x: Array, v: Array, torque: Array) -> Array:
    """Direction of sliding: of the velocity, at rest of a pull above breakaway, zero when the load is held."""
    pull = machine.pull(x, np.zeros_like(v), torque)
    lean = np.sign(pull)
    breaks = np.abs(pull) > machine.dry(np.zeros_like(v), lean)
    return np.where(v != 0.0, np.sign(v), np.where(breaks, lean, 0.0))


def _through_rest(
    machine: Machine, x: Array, v: Array, beyond: Array, drive: Sequence[Array], h: Array, way: Array
) -> tuple[Array, Array]:
    """A step in which the load comes to rest: up to the instant of rest, then held or away again."""
    least, most = np.zeros_like(h), np.ones_like(h)
    share = np.clip(v / np.where(v == beyond, 1.0, v - beyond), 0.0, 1.0)
    for _ in range(30):  # regula falsi with bisection as its guard
        at_x, at_v = _runge_kutta(machine, x, v, drive, share * h, way)
        still = at_v * way > 0
        least, most = np.where(still, share, least), np.where(still, most, share)
        if np.all(np.abs(at_v) < 1e-13):
            break
        slope = (at_v - v) / np.where(share > 0, share, 1.0)
        guess = share - at_v / np.where(slope == 0.0, -1.0, slope)
        share = np.where((guess > least) & (guess < most), guess, (least + most) / 2)
    rest = np.zeros_like(v)
    left = (1.0 - share) * h
    again = _way(machine, at_x, rest, drive[2])
    far_x, far_v = _runge_kutta(machine, at_x, rest, [drive[2]] * 3, left, again)
    back = far_v * again < 0  # a pull at the edge of breakaway: hold for the remainder
    held = (again == 0) | back
    return np.where(held, at_x, far_x), np.where(held, 0.0, far_v)


def _runge_kutta(
    machine: Machine, x: Array, v: Array, drive: Sequence[Array], h: Array, way: Array | None
) -> tuple[Array, Array]:
    """Classical fourth-order step with friction of one direction; torque at its start, middle and end."""

    def acceleration(angle: Array, speed: Array, torque: Array) -> Array:
        total = machine.pull(angle, speed, torque)
        if way is not None:
            total = total - way * machine.dry(speed, way)
        return np.asarray(total / machine.inertia)

    half = h / 2
    a1 = acceleration(x, v, drive[0])
    v2 = v + half * a1
    a2 = acceleration(x + half * v, v2, drive[1])
    v3 = v + half * a2
    a3 = acceleration(x + half * v2, v3, drive[1])
    v4 = v + h * a3
    a4 = acceleration(x + h * v3, v4, drive[2])
    return x + h / 6 * (v + 2 * v2 + 2 * v3 + v4), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


# What is played into the machines.


def excitation(seed: int, *, duration: float = 60.0, sample_time: float = 0.005, scale: float = 1.0) -> Array:
    """(T,) a slow chirp, steps, a fast chirp, small steps: a quarter of the time each, sizes drawn from the seed."""
    rng = np.random.default_rng([seed, 1])
    quarter = duration / 4
    parts = [
        chirp(rng.uniform(4.0, 6.0), 0.05, rng.uniform(0.5, 0.8), quarter, sample_time),
        random_steps(rng, 2.0, 8.0, quarter, sample_time),
        chirp(rng.uniform(6.0, 9.0), 0.5, rng.uniform(4.0, 6.0), quarter, sample_time),
        random_steps(rng, 0.7, 1.8, quarter, sample_time),
    ]
    return scale * np.concatenate(parts)


def chirp_and_steps(seed: int, *, duration: float = 60.0, sample_time: float = 0.005) -> Array:
    """(T,) one chirp and a few steps: the least that should do for the four parameters."""
    rng = np.random.default_rng([seed, 2])
    half = duration / 2
    sweep = chirp(rng.uniform(4.0, 7.0), 0.05, 1.0, half, sample_time)
    return np.concatenate((sweep, random_steps(rng, 1.0, 6.0, half, sample_time)))


def chirp(amplitude: float, start: float, stop: float, duration: float, sample_time: float) -> Array:
    t = np.arange(round(duration / sample_time)) * sample_time
    return amplitude * np.sin(2 * np.pi * (start * t + (stop - start) * t**2 / (2 * duration)))


def random_steps(rng: np.random.Generator, least: float, most: float, duration: float, sample_time: float) -> Array:
    """(T,) levels of alternating sign with a size between `least` and `most`, each held for 0.5 to 2 s."""
    count = round(duration / sample_time)
    levels: list[Array] = []
    sign = 1.0
    while sum(map(len, levels)) < count:
        hold = round(rng.uniform(0.5, 2.0) / sample_time)
        levels.append(np.full(hold, sign * rng.uniform(least, most)))
        sign = -sign
    return np.concatenate(levels)[:count]


def wandering_reference(seed: int, *, duration: float = 60.0, sample_time: float = 0.005) -> Array:
    """(T,) smooth moves between random angles [rad], for closed loops."""
    rng = np.random.default_rng([seed, 3])
    t = np.arange(round(duration / sample_time)) * sample_time
    tones = rng.uniform(0.03, 0.3, 6)
    waves = np.sin(2 * np.pi * np.outer(t, tones) + rng.uniform(0, 2 * np.pi, 6)) @ (1.0 / (1.0 + 3.0 * tones))
    plateaus = np.repeat(rng.uniform(-1.5, 1.5, t.size // 600 + 1), 600)[: t.size]
    return np.asarray(waves + plateaus)


def load_fluctuation(
    seed: int, rms: float, shape: tuple[int, int], *, correlation_time: float = 0.02, sample_time: float = 0.005
) -> Array:
    """(T, B) load torque that fluctuates at random (Ornstein-Uhlenbeck) with a given rms [N m]."""
    rng = np.random.default_rng([seed, 4])
    keep = np.exp(-sample_time / correlation_time)
    kicks = rms * np.sqrt(1 - keep**2) * rng.standard_normal(shape)
    kicks[0] = rms * rng.standard_normal(shape[1])
    path = np.empty(shape)
    path[0] = kicks[0]
    for k in range(1, shape[0]):
        path[k] = keep * path[k - 1] + kicks[k]
    return path
