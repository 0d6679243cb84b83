"""Time of one controller step, called from Python, in closed loop on the paper's plant, compared with other solvers.

    python benchmarks/mpc_step.py

Every solver gets the same programs, 500 of them on a sine that saturates the torques and 500 on a step. Our rows are
the whole step, including estimator, status and reading of the torques; those of the peers are their own call only,
except do-mpc, whose call is the whole of its step. Each run is repeated, and the least time of each step counts,
because the machine may be busy. The loop is the same each time, so the remaining spread is that of the programs. The
cost is that of the closed loop, relative to sequential quadratic programming to convergence in each step; "beyond" is
the largest violation of the torque bounds. Prints the tables and writes them to benchmarks/results/mpc_step.txt.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpc_peers import MISSING, PEERS, Peer

from mpc import Controller
from plant import GearTrain, ServoModel, sample_step
from plant.effects import ActuatorLag, CoulombFriction

STEPS, SAMPLE_TIME, REPEATS = 500, 0.005, 15
PEER_REPEATS = 4
GEARS = GearTrain.paper()
PAPER = ServoModel.paper()
REFERENCES: tuple[Callable[[np.ndarray], np.ndarray], ...] = (
    lambda t: 0.4 * np.sin(2 * np.pi * 0.5 * t),
    lambda t: 0.3 * (t > 0.3),
)


@dataclass(frozen=True, kw_only=True)
class Run:
    """Consecutive steps: times [s], cost [rad^2], number of steps that were not optimal, and largest violation."""

    times: np.ndarray
    cost: float
    degraded: int
    beyond: float


def closed_loop(controller: Controller, model: ServoModel, reference: Callable[[np.ndarray], np.ndarray]) -> Run:
    step, state = sample_step(model, substeps=4), np.zeros(len(model.states))
    wanted = reference(np.arange(STEPS + controller.horizon + 1) * SAMPLE_TIME)
    times, cost, last, degraded, beyond = np.empty(STEPS), 0.0, 0.0, 0, 0.0
    for k in range(STEPS):
        preview = wanted[k : k + controller.horizon + 1]
        begin = time.perf_counter()
        control = controller.step(state[0], preview)
        control.torques  # noqa: B018 (an attribute is read when it is asked for)
        times[k] = time.perf_counter() - begin
        degraded += control.status != "optimal"
        low, high = controller.min_torque - np.abs(control.torques), np.abs(control.torques) - controller.max_torque
        beyond = max(beyond, float(np.max(low)), float(np.max(high)))
        torque = float(GEARS.output_torque(control.torques))
        cost += (state[0] - wanted[k]) ** 2 + controller._rate_weight * (torque - last) ** 2
        last = torque
        inputs = np.array([torque, torque, 0.0, np.inf, 0.0, SAMPLE_TIME, 0.0, 0.0])
        state = np.asarray(step(state, inputs, model.values))[:, 0]
    return Run(times=times[1:], cost=cost, degraded=degraded, beyond=max(beyond, 0.0))


def ours(model: ServoModel, horizon: int, **options: int) -> Controller:
    return Controller(model, GEARS, sample_time=SAMPLE_TIME, horizon=horizon, **options)


def interpreted(model: ServoModel, horizon: int) -> Controller:
    controller = ours(model, horizon)
    controller._step = controller._interpreted
    return controller


def figures(runs: list[Run]) -> str:
    """Median, 99th percentile and maximum over the steps, each the least of its repetitions [us]."""
    times = np.min([run.times for run in runs], axis=0)
    return "".join(f"{1e6 * value:10.1f}" for value in (np.median(times), np.quantile(times, 0.99), np.max(times)))


def joined(runs: list[Run]) -> Run:
    return Run(
        times=np.concatenate([run.times for run in runs]),
        cost=sum(run.cost for run in runs),
        degraded=sum(run.degraded for run in runs),
        beyond=max(run.beyond for run in runs),
    )


def both_references(make: Callable[[], Controller], model: ServoModel) -> Run:
    return joined([closed_loop(make(), model, reference) for reference in REFERENCES])


def peer_run(kind: type[Peer], horizon: int) -> Run:
    runs = []
    for reference in REFERENCES:
        peer = kind(ours(PAPER, horizon))
        run = closed_loop(peer.controller, PAPER, reference)
        runs.append(Run(times=np.array(peer.times[1:]), cost=run.cost, degraded=run.degraded, beyond=peer.beyond))
    return joined(runs)


def line(name: str, horizon: int, runs: list[Run], best: float | None) -> str:
    cost = "" if best is None else f"{runs[0].cost / best - 1:12.1e}{runs[0].beyond:10.0e}"
    return f"{name:34}{horizon:5d}{figures(runs)}{runs[0].degraded:10d}{cost}"


def tables() -> list[str]:
    titles = f"{'':34}{'N':>5}{'median':>10}{'99 %':>10}{'max':>10}{'degraded':>10}"
    shared = f"{os.cpu_count()} cores that others use too (load {os.getloadavg()[1]:.0f})"
    lines = [
        f"The paper's plant, 1000 steps at 5 ms [us], each step the least of {REPEATS} runs (peers: {PEER_REPEATS},"
    ]
    lines += [f"do-mpc: one), on {shared}", ""]
    lines.append(f"{titles}{'cost':>12}{'beyond':>10}")
    for horizon in (20, 30, 50):
        best = both_references(lambda N=horizon: ours(PAPER, N, sqp_iterations=30), PAPER).cost
        for name, make in (("one step, machine code", ours), ("one step, CasADi and NumPy alone", interpreted)):
            runs = [both_references(lambda N=horizon, m=make: m(PAPER, N), PAPER) for _ in range(REPEATS)]
            lines.append(line(name, horizon, runs, best))
        for name, kind in PEERS.items():
            runs = [peer_run(kind, horizon) for _ in range(1 if "do-mpc" in name else PEER_REPEATS)]
            lines.append(line(f"{name}, {kind.timed}", horizon, runs, best))
        lines += [f"{name:34}{horizon:5d}   not installed" for name in MISSING]
        lines.append("")
    rich = PAPER.with_effect(CoulombFriction(torque=0.1)).with_effect(ActuatorLag(time_constant=0.005))
    lines += ["Long horizons and a richer model, machine code", "", titles]
    for name, model, horizons in (
        ("the paper's plant", PAPER, (100, 200, 500)),
        ("with friction and lag", rich, (20, 30, 50)),
    ):
        for horizon in horizons:
            runs = [both_references(lambda N=horizon, m=model: ours(m, N), model) for _ in range(REPEATS)]
            lines.append(line(name, horizon, runs, None))
    return lines


def main() -> None:
    lines = tables()
    print("\n".join(lines))
    folder = Path(__file__).parent / "results"
    folder.mkdir(exist_ok=True)
    (folder / "mpc_step.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
