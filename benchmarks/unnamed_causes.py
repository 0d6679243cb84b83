"""Effects that are not in the catalogue: their diagnosis, and the share of the gain by non-parametric effects.

    python benchmarks/unnamed_causes.py

Prints the table and writes it to benchmarks/results/unnamed_causes.txt. The oracle fits the true law. The true laws are
simulated by the plant's own integrator with a finer step: only the law is hidden, not the machine.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

from machine import excitation  # noqa: E402

from diagnosis import diagnose  # noqa: E402
from identification.fit import fit  # noqa: E402
from identification.log import Log, Run  # noqa: E402
from identification.problem import Problem  # noqa: E402
from identification.simulation import free_simulation  # noqa: E402
from plant import ServoModel, simulate  # noqa: E402
from plant.effects import DeadZone, Effect, Stage, State  # noqa: E402
from plant.effects.effect import Expression, Moment, parameter  # noqa: E402

SEEDS = (1, 2, 3)
SAMPLE_TIME, NOISE, COUNTS = 0.005, 1e-3, 2**17


@dataclass(frozen=True, kw_only=True)
class Hidden(Effect):
    """A law with one size."""

    equation = ""
    signature = ""
    stage = Stage.LOAD

    size: float = parameter("-", "size", lower=0.0)


class FrictionOfPlace(Hidden):
    """Dry friction with two maxima per turn."""

    name = title = "friction that varies over the turn"

    def dry_friction(self, at: Moment) -> tuple[Expression, Expression]:
        level = self.size * (1 + ca.sin(2 * at.angle))
        return level, level


class Teeth(Hidden):
    """Narrow pulses, nine per turn."""

    name = title = "pulses over the turn"

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        return self.size * ca.exp(-6 * (1 - ca.cos(9 * at.angle)))


class Ratio(Hidden):
    """A transmission whose ratio changes over the turn."""

    name = title = "ratio that varies over the turn"

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        return self.size * at.torque * ca.sin(at.angle + 0.5)


class Warming(Hidden):
    """Damping that decreases while the grease warms up."""

    name = title = "damping that fades in time"
    clocked = True

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        return -self.size * ca.exp(-at.time / 8.0) * at.velocity


class Disc(Hidden):
    """An encoder whose error has three harmonics of a turn."""

    name = title = "encoder error of three harmonics"
    stage = Stage.SENSOR

    def measurement(self, angle: Expression, state: Expression) -> Expression:
        return angle + self.size * (ca.sin(angle) + 0.6 * ca.cos(2 * angle) + 0.3 * ca.sin(3 * angle))


class Windage(Hidden):
    """Drag with the cube of the speed."""

    name = title = "drag with the cube of the speed"

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        return -self.size * at.velocity**3


class Harness(Hidden):
    """Dragged cables, stiffer on one side than on the other."""

    name = title = "loop of dragged wires"
    states = (State.RELAXED,)
    longest_step = 1e-3

    def slide(self, state: Expression, travel: Expression) -> Expression:
        direction = ca.sign(travel)
        return direction + (state - direction) * ca.exp(-ca.fabs(travel) / 0.4)

    def load_torque(self, at: Moment, state: Expression) -> Expression:
        memory = self.slide(state, at.travel)
        return -self.size * (memory + 0.5 * memory**2)


CAUSES = (
    FrictionOfPlace(size=0.15),
    Teeth(size=0.4),
    Ratio(size=0.15),
    Warming(size=0.4),
    Disc(size=0.01),
    Windage(size=0.01),
    Harness(size=0.3),
)


def truth(cause: Hidden) -> ServoModel:
    """The true model of the logs."""
    bare = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8)
    return bare.with_effect(DeadZone(half_width=0.5)).with_effect(cause)


def recorded(cause: Hidden, seed: int, duration: float) -> Log:
    """A log of the true model, with noise and the quantisation of a 17-bit encoder."""
    command = excitation(seed, duration=duration)
    moved = simulate(truth(cause), command=command, dt=SAMPLE_TIME, substeps=5)[: command.size, 0]
    seen = np.array([float(cause.measurement(angle, 0.0)) for angle in moved])
    noisy = seen + NOISE * np.random.default_rng(seed).standard_normal(command.size)
    count = 2.0 * np.pi / COUNTS
    run = Run(
        label=cause.name,
        number=0,
        time=SAMPLE_TIME * np.arange(command.size),
        command=command,
        output=count * np.round(noisy / count),
        valid=np.ones(command.size, dtype=bool),
        servo_gain=np.zeros(command.size),
    )
    return Log(runs=(run,), axis="rotary")


def error(model: ServoModel, log: Log) -> float:
    """Rms error of a free simulation [rad]."""
    simulated = free_simulation(log, model)
    errors = np.concatenate([s - run.output for s, run in zip(simulated, log.runs, strict=True)])
    return float(np.sqrt(np.mean(errors**2)))


def row(cause: Hidden, seed: int) -> tuple[str, float]:
    """The result on one log, and the share of the oracle's reduction of the validation error."""
    log, held = recorded(cause, 2 * seed, 30.0), recorded(cause, 2 * seed + 1, 15.0)
    begin = time.perf_counter()
    found = diagnose(log, None, held)
    taken = time.perf_counter() - begin
    model = truth(cause)
    near = fit(log, model, fixed=[name for name in model.names if name != "inertia"])
    refitted = Problem.of(log, model).descend(near)
    before, after, best = (error(each.model, held) for each in (found.base, found.extended, refitted))
    share = (before - after) / (before - best)
    names = ", ".join(f"{c.effect} {c.probability:.3f}" for c in found.causes) or "-"
    over = ", ".join(found.unexplained.depends_on) or "-"
    return f"{cause.name:36}{seed:3} {found.verdict:10}{share:8.3f}{taken:7.1f} s  over {over:18} {names}", share


def main() -> None:
    lines = [f"{'hidden':36}{'log':>3} {'verdict':10}{'gain':>8}   (share of the oracle's cut of the held-out error)"]
    shares = []
    for cause in CAUSES:
        for seed in SEEDS:
            line, share = row(cause, seed)
            print(line, flush=True)
            lines.append(line)
            shares.append(share)
    lines.append(f"share of the oracle's gain: median {np.median(shares):.3f}, least {min(shares):.3f}")
    print(lines[-1])
    folder = HERE / "results"
    folder.mkdir(exist_ok=True)
    (folder / "unnamed_causes.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
