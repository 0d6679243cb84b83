"""Computing time with limits of angle, speed and torque rate, and how well the limits are kept.

    python benchmarks/mpc_limits.py

A sine and a step that exceed the limits: on a servo that equals its model, for the times; and on the rig, with noise,
friction and backlash, for the violations. Writes benchmarks/results/mpc_limits.txt.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpc import Controller, closed_loop
from plant import GearTrain, Rig, ServoModel, sample_step

Array = NDArray[np.float64]
STEPS, SAMPLE_TIME, REPEATS = 500, 0.005, 15
GEARS, PAPER, RIG = GearTrain.paper(), ServoModel.paper(), Rig.paper_like()
OF_RIG = ServoModel(inertia=RIG.total_inertia, gravity=0.5, viscous_friction=0.8)
LIMITS: dict[str, dict[str, Any]] = {
    "none": {},
    "far away": {"angle_limits": (-9.0, 9.0), "speed_limit": 9.0},
    "angle 0.2 rad": {"angle_limits": (-0.2, 0.2)},
    "speed 0.3 rad/s": {"speed_limit": 0.3},
    "torque rate 20 N m/s": {"torque_rate": 20.0},
    "all three": {"angle_limits": (-0.2, 0.2), "speed_limit": 0.3, "torque_rate": 20.0},
}
BORNE: dict[str, dict[str, Any]] = {"speed 0.3, rate 80": {"speed_limit": 0.3, "torque_rate": 80.0}}
"""A change of the torque in a sample that does not exceed the minimum contact torque, 0.05 N m at the pinion."""

REFERENCES: tuple[Callable[[Array], Array], ...] = (
    lambda t: 0.4 * np.sin(2 * np.pi * 0.5 * t),
    lambda t: 0.3 * (t > 0.3),
)


def timed(horizon: int, options: dict[str, Any]) -> tuple[Array, int, int]:
    """Times of the steps [s], number of steps with active limits, and number of steps that were not optimal."""
    step, times, pushed, degraded = sample_step(PAPER, substeps=4), [], 0, 0
    for reference in REFERENCES:
        controller = Controller(PAPER, GEARS, horizon=horizon, **options)
        wanted = reference(np.arange(STEPS + horizon + 1) * SAMPLE_TIME)
        state, last = np.zeros(len(PAPER.states)), 0.0
        for k in range(STEPS):
            begin = time.perf_counter()
            control = controller.step(state[0], wanted[k : k + horizon + 1])
            times.append(time.perf_counter() - begin)
            pushed += bool(np.any(controller._arrays["forces"].reshape(horizon, -1)[:, 1:]))
            degraded += control.status != "optimal"
            torque = float(GEARS.output_torque(control.torques))
            inputs = np.array([torque, last, 0.0, np.inf, 0.0, SAMPLE_TIME, 0.0, 0.0])
            state, last = np.asarray(step(state, inputs, PAPER.values))[:, 0], torque
    return np.array(times), pushed, degraded


def kept(options: dict[str, Any]) -> str:
    """On the rig, 6 s each of a sine and a step: the extreme values, and the minimum contact torque."""
    angle, speed, rate, flank, degraded = 0.0, 0.0, 0.0, np.inf, 0
    for reference in REFERENCES:
        loop = closed_loop(Controller(OF_RIG, GEARS, min_torque=0.05, **options), RIG, reference, 6.0, seed=0)
        angle, speed = max(angle, float(np.max(np.abs(loop.angle)))), max(speed, float(np.max(np.abs(loop.velocity))))
        torque = GEARS.output_torque(loop.torques)
        rate = max(rate, float(np.max(np.abs(np.diff(torque)))) / SAMPLE_TIME)
        flank, degraded = min(flank, loop.minimum_contact_torque), degraded + loop.degraded
    return f"{angle:14.6f}{speed:14.5f}{rate:12.1f}{flank:12.3f}{degraded:10d}"


def main() -> None:
    shared = f"{os.cpu_count()} cores that others use too (load {os.getloadavg()[1]:.0f})"
    lines = [
        f"{2 * STEPS} steps at 5 ms of the paper's plant [us], machine code, each step the least of {REPEATS} runs,"
    ]
    lines += [f"on {shared}", ""]
    lines.append(f"{'limits':24}{'N':>5}{'median':>10}{'99 %':>10}{'max':>10}{'pushed back':>14}{'degraded':>10}")
    for name, options in LIMITS.items():
        for horizon in (20, 30, 50):
            runs = [timed(horizon, options) for _ in range(REPEATS)]
            least = np.min([times for times, _, _ in runs], axis=0)
            each = (np.median(least), np.quantile(least, 0.99), np.max(least))
            figures = "".join(f"{1e6 * value:10.1f}" for value in each)
            lines.append(f"{name:24}{horizon:5d}{figures}{runs[0][1]:14d}{runs[0][2]:10d}")
            print(lines[-1], flush=True)
    lines += ["", "On the rig, min_torque 0.05 N m, both references, 12 s: the greatest and the least of each", ""]
    lines.append(f"{'limits':24}{'angle [rad]':>14}{'speed':>14}{'N m/s':>12}{'flank [N m]':>12}{'degraded':>10}")
    for name, options in (LIMITS | BORNE).items():
        lines.append(f"{name:24}{kept(options)}")
        print(lines[-1], flush=True)
    (Path(__file__).parent / "results" / "mpc_limits.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
