"""A randomly drawn log: machine, drive, sensor, command, hidden effects and unmodelled torque, all from one seed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import cont2discrete, lfilter

from drawn_machines.commands import KINDS, pushes, smoothed
from drawn_machines.hidden import Basis, drawn_effects, rms
from drawn_machines.loop import Loop
from drawn_machines.motion import Array, Law, Motion, play
from drawn_machines.servo import Machine
from drawn_machines.unmodelled_torque import drawn_rest

RATES = (50.0, 100.0, 125.0, 200.0, 250.0, 400.0, 500.0, 1000.0, 2000.0, 4000.0)  # [Hz]
LOOPS = {"open": 0.45, "closed": 0.28, "closed, current": 0.15, "position servo": 0.12}
RESTS = (0.0, 0.003, 0.01, 0.03)  # rms of the unmodelled torque, relative to that of the torque
HOW_MANY = {0: 0.15, 1: 0.5, 2: 0.28, 3: 0.07}
ATTEMPTS = 60


@dataclass(frozen=True, kw_only=True)
class Setting:
    """Settings that are drawn before the simulation.

    Attributes:
        fastest: highest frequency of the motion [rad/s].
        speed: intended rms speed [rad/s].
        noise: of a measurement before rounding [rad].
        count: step of the encoder [rad].
        clock: "even", or 1 % scatter of the "stamps" alone or of the "instants" too.
    """

    kind: str
    loop: str
    rate: float
    samples: tuple[int, ...]
    machine: Machine
    fastest: float
    speed: float
    noise: float
    count: float
    clock: str
    rest: float
    effects: int

    @property
    def sample_time(self) -> float:
        return 1.0 / self.rate


def drawn_setting(rng: np.random.Generator) -> Setting | None:
    """Machine, drive and sensor; None if they do not fit together."""
    total = int(np.exp(rng.uniform(np.log(2000), np.log(20000))))
    runs = int(rng.choice([1, 2, 3], p=[0.6, 0.25, 0.15]))
    inertia = 10.0 ** rng.uniform(-5.0, 1.0)
    reach = 10.0 ** rng.uniform(-1.0, 1.3)  # amplitude of the motion [rad]
    push = 300.0 * inertia**-0.2 * 10.0 ** rng.uniform(-1.0, 0.7)  # acceleration [rad/s^2]
    fastest = float(np.sqrt(push / reach))
    aimed = 10.0 ** rng.uniform(np.log10(max(0.002, 30.0 * runs / total)), np.log10(0.05))
    rate = min(RATES, key=lambda each: abs(np.log(each * aimed * 2.0 * np.pi / fastest)))
    if not 0.0015 < fastest / (2.0 * np.pi * rate) < 0.06 or reach * fastest > 400.0:
        return None
    loop = str(rng.choice(list(LOOPS), p=list(LOOPS.values())))
    torque = inertia * push
    swing = 2.5 * fastest if loop == "open" else 0.3 * rate  # greatest frequency of the load as a pendulum [rad/s]
    weight = min(torque * 10.0 ** rng.uniform(-1.0, 0.5), inertia * swing**2)
    machine = Machine(
        inertia=inertia,
        gravity=0.0 if rng.random() < 0.4 else weight,
        viscous_friction=inertia * fastest * 10.0 ** rng.uniform(-1.5, 0.3),
        dead_zone=torque * 10.0 ** rng.uniform(-2.0, -0.8) if rng.random() < 0.25 and "current" not in loop else 0.0,
        effects={},
    )
    count = 2.0 * np.pi / 2.0 ** int(rng.integers(12, 21))
    while count > reach / 100.0:
        count *= 0.5
    return Setting(
        kind=str(rng.choice(list(KINDS))),
        loop=loop,
        rate=rate,
        samples=(total // runs,) * runs,
        machine=machine,
        fastest=fastest,
        speed=reach * fastest / np.sqrt(2.0),
        noise=count * 10.0 ** rng.uniform(-1.0, 0.5),
        count=count,
        clock=str(rng.choice(["even", "stamps", "instants"], p=[0.8, 0.1, 0.1])),
        rest=float(rng.choice(RESTS)),
        effects=int(rng.choice(list(HOW_MANY), p=list(HOW_MANY.values()))),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Runs:
    """Commands, clocks and initial angles of the runs of a log."""

    times: tuple[Array, ...]
    shapes: tuple[Array, ...]
    begins: tuple[float, ...]
    loop: Loop | None
    scale: float

    def law(self, place: int) -> Law:
        """The command law of the machine in a run."""
        wanted = self.scale * self.shapes[place]
        if self.loop is None:
            values = wanted.tolist()
            return lambda k, reading, time: values[k]
        return self.loop.law(self.begins[place] + wanted)

    def played(self, machine: Machine, noise: list[Array], count: float, substeps: int) -> list[Motion]:
        """Simulate all runs."""
        return [
            play(machine, self.law(i), times, self.begins[i], noise=noise[i], count=count, substeps=substeps)
            for i, times in enumerate(self.times)
        ]


def drawn_runs(rng: np.random.Generator, s: Setting) -> Runs:
    """Commands of one kind, different for each run, on a clock that continues between them."""
    dt, unit = s.sample_time, s.fastest * s.sample_time / (2.0 * np.pi)
    times, shapes, begins = [], [], []
    begin = 0.0
    for n in s.samples:
        even = begin + dt * np.arange(n + 1)
        scatter = 0.01 * dt * rng.standard_normal(n + 1) if s.clock == "instants" else 0.0
        times.append(even + scatter - (scatter[0] if begin == 0.0 and np.ndim(scatter) else 0.0))
        begin = dt * round((even[-1] + 0.1 * n * dt * rng.uniform(1.0, 2.0)) / dt)
        draw = pushes if s.kind == "moves" and s.loop == "open" else KINDS[s.kind]
        shape = draw(rng, n, unit) * rng.uniform(0.7, 1.3)
        shapes.append(shape if s.loop == "open" else smoothed(shape, unit))
        hanging = -0.5 * np.pi if s.loop == "open" and s.machine.gravity else rng.uniform(-np.pi, np.pi)
        begins.append(float(hanging if not begins or s.loop == "open" else begins[0]))
    if s.loop == "open":
        runs = Runs(times=tuple(times), shapes=tuple(shapes), begins=tuple(begins), loop=None, scale=1.0)
        return _pushed(s, runs)
    loop = Loop.drawn(rng, s.machine, s.fastest, dt, inner=s.loop == "position servo")
    reach = s.speed / s.fastest * np.sqrt(2.0)
    return Runs(times=tuple(times), shapes=tuple(shapes), begins=tuple(begins), loop=loop, scale=reach)


def _pushed(s: Setting, runs: Runs) -> Runs:
    """Scale the torque for the drawn speed, in three trials of the first samples."""
    scale = s.machine.inertia * s.speed * s.fastest
    short = slice(0, min(3000, s.samples[0]))
    trial = replace(
        runs, times=(runs.times[0][: short.stop + 1],), shapes=(runs.shapes[0][short],), begins=runs.begins[:1]
    )
    for _ in range(3):
        (motion,) = replace(trial, scale=scale).played(s.machine, [np.zeros(short.stop)], 0.0, 1)
        factor = s.speed / max(rms(motion.velocity), 1e-3 * s.speed)
        if abs(np.log(factor)) < 0.2:
            break
        scale *= float(np.clip(factor, 0.2, 5.0))
    return replace(runs, scale=scale)


def basis_of(s: Setting, machine: Machine, motions: list[Motion]) -> Basis:
    """The motion without effects, to which effects are scaled."""

    def joined(name: str) -> Array:
        return np.concatenate([getattr(motion, name) for motion in motions])

    torque = joined("driving")
    return Basis(
        time=joined("time"),
        angle=joined("angle"),
        velocity=joined("velocity"),
        acceleration=joined("acceleration"),
        torque=torque,
        inertia=machine.inertia,
        gravity=machine.gravity,
        dead_zone=machine.dead_zone,
        sample_time=s.sample_time,
        fastest=s.fastest,
        noise=float(np.hypot(s.noise, s.count / np.sqrt(12.0))),
        level=rms(torque),
        servo=s.loop == "position servo",
    )


def with_hidden(rng: np.random.Generator, s: Setting, machine: Machine, basis: Basis) -> Machine:
    """The machine with hidden effects and with unmodelled torque of the drawn size."""
    current = "current" in s.loop
    effects = drawn_effects(rng, basis, slow=s.kind == "slow", measured=current, count=s.effects)
    machine = replace(machine, effects=effects)
    if not s.rest:
        return machine
    wanted = s.rest * basis.level
    rest = drawn_rest(rng, basis.span, basis.speed, float(basis.time[-1]))
    share = 0.0
    if rng.random() < 1.0 / 3.0 and not machine.motor_share:
        share = rng.uniform(0.3, 0.8)
        frequency = min(basis.fastest * 10.0 ** rng.uniform(0.3, 1.0), 0.5 / basis.sample_time)
        damping = 10.0 ** rng.uniform(-1.3, 0.3)
        swung = _swung(basis.torque, frequency, damping, basis.sample_time)
        machine = replace(machine, resonant=(share * wanted / rms(swung - basis.torque), frequency, damping))
    along = rest.along(basis.angle, basis.velocity, basis.time)
    return replace(machine, rest=rest.scaled(float(np.sqrt(1.0 - share**2)) * wanted / rms(along)))


def _swung(torque: Array, frequency: float, damping: float, dt: float) -> Array:
    """A torque after a resonance."""
    system = ([frequency**2], [1.0, 2.0 * damping * frequency, frequency**2])
    b, a, _ = cont2discrete(system, dt, method="zoh")
    return np.asarray(lfilter(b.ravel(), a, torque))
