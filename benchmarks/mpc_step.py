"""Time of one controller step, as called from Python, in closed loop on the rig.

    python benchmarks/mpc_step.py

One row for each model and horizon: median, 99th percentile and maximum, and how many steps were not optimal.
"""

from __future__ import annotations

import time

import numpy as np
from rich.console import Console
from rich.table import Table

from mpc import Controller
from plant.effects import ActuatorLag, CoulombFriction
from plant.gears import GearTrain
from plant.rig import Rig
from plant.servo import ServoModel

STEPS = 600
SAMPLE_TIME = 0.005
MODELS = {
    "rigid": ServoModel(inertia=2.08, gravity=0.5, viscous_friction=0.8),
    "with dead zone": ServoModel.paper(),
    "with friction and lag": ServoModel(
        inertia=2.08,
        gravity=0.5,
        viscous_friction=0.8,
        effects=(CoulombFriction(torque=0.1), ActuatorLag(time_constant=0.005)),
    ),
}


def step_times(model: ServoModel, horizon: int) -> tuple[np.ndarray, int]:
    """Duration of each step [s] on a sine with a jump, and the number of degraded ones."""
    controller = Controller(model, GearTrain.paper(), sample_time=SAMPLE_TIME, horizon=horizon)
    moments = np.arange(STEPS + horizon + 1) * SAMPLE_TIME
    wanted = 0.1 * (1 - np.cos(2 * np.pi * 0.4 * moments)) + 0.1 * (moments > 1.5)
    rig, rng = Rig.paper_like(), np.random.default_rng(0)
    state, durations, degraded = rig.rest(), np.empty(STEPS), 0
    for k in range(STEPS):
        angle = rig.measure(state, rng)
        begin = time.perf_counter()
        control = controller.step(angle, wanted[k : k + horizon + 1])
        durations[k] = time.perf_counter() - begin
        degraded += control.status != "optimal"
        state = rig.advance(state, control.torques, SAMPLE_TIME)
    return durations[1:], degraded  # the first step builds the functions


def main() -> None:
    table = Table(title="One controller step [us]")
    table.add_column("model")
    for name in ("N", "median", "99 %", "max", "degraded"):
        table.add_column(name, justify="right")
    for name, model in MODELS.items():
        for horizon in (20, 30, 50):
            durations, degraded = step_times(model, horizon)
            figures = [np.median(durations), np.quantile(durations, 0.99), np.max(durations)]
            table.add_row(name, str(horizon), *(f"{1e6 * figure:.0f}" for figure in figures), str(degraded))
    Console().print(table)


if __name__ == "__main__":
    main()
