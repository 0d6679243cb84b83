"""Trade-off of loop margins: bandwidth and disturbance rate against margins, tracking, disturbance rejection and noise.

    python benchmarks/mpc_tuning.py

The margins are those of `analyse_loop` for the paper's plant without dead zone; the rest is measured on the rig, with
an encoder of 2^17 steps. Writes benchmarks/results/mpc_tuning.txt.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mpc import Controller, analyse_loop, closed_loop
from plant import GearTrain, Rig, ServoModel

Array = NDArray[np.float64]
GEARS, RIG, RUBS = GearTrain.paper(), Rig.paper_like(), Rig.paper_like(coulomb_friction=0.4)
MODEL = ServoModel(inertia=RIG.total_inertia, gravity=0.5, viscous_friction=0.8)
PAPER = ServoModel.paper().without_effect("dead_zone")
TUNINGS = ((4.0, 1.0), (4.0, 3.0), (4.0, 10.0), (4.0, 30.0), (3.0, 1.0), (3.0, 3.0), (3.0, 10.0))
TUNINGS += ((2.0, 1.0), (2.0, 3.0), (2.0, 5.0), (1.5, 3.0))  # bandwidth [Hz], disturbance rate [N m/sqrt(s)]
SETTLED = 50  # samples for the estimate of gravity to converge


def swing(time: Array) -> Array:
    """Back and forth within 0.4 rad at a quarter hertz [rad]."""
    return np.asarray(0.2 * (1 - np.cos(2 * np.pi * 0.25 * time)))


def row(bandwidth: float, rate: float) -> str:
    """Margins, and their effect on the errors."""

    def fresh(model: ServoModel = MODEL) -> Controller:
        return Controller(model, GEARS, bandwidth=bandwidth, disturbance_rate=rate)

    loop = analyse_loop(fresh(PAPER), angle=0.3)
    swung, rubbed = (closed_loop(fresh(), rig, swing, 3.0, seed=0) for rig in (RIG, RUBS))
    pushes = np.where(np.arange(500) > 200, 0.4, 0.0)
    pushed = closed_loop(fresh(), RIG, 0.3, 2.5, seed=0, disturbance=pushes)
    rest = closed_loop(fresh(), RIG, 0.3, 2.0, seed=0)
    errors = [1e6 * np.sqrt(np.mean((each.angle - each.reference)[SETTLED:] ** 2)) for each in (swung, rubbed)]
    peak = 1e6 * np.max(np.abs(pushed.angle[200:] - 0.3))
    shaking = np.std(np.diff(GEARS.output_torque(rest.torques))[200:])
    flank = min(each.minimum_contact_torque for each in (swung, rubbed, pushed, rest))
    margins = f"{loop.phase_margin:9.1f}{loop.peak_sensitivity:7.2f}{1e3 * loop.delay_margin:8.1f}"
    return (
        f"{bandwidth:10.1f}{rate:10.0f}{margins}{errors[0]:10.1f}{errors[1]:12.1f}{peak:10.1f}"
        f"{shaking:12.4f}{flank:10.3f}"
    )


def main() -> None:
    warnings.simplefilter("ignore")  # python-control on poles near the unit circle
    lines = ["Margins of the loop and what they cost; errors are root mean squares, the push is of 0.4 N m", ""]
    lines.append(
        f"{'bandwidth':>10}{'rate of d':>10}{'margin':>9}{'Ms':>7}{'delay':>8}{'swing':>10}{'+ friction':>12}"
        f"{'push':>10}{'torque step':>12}{'flank':>10}"
    )
    lines.append(
        f"{'[Hz]':>10}{'':10}{'[deg]':>9}{'':7}{'[ms]':>8}{'[urad]':>10}{'[urad]':>12}"
        f"{'[urad]':>10}{'[N m]':>12}{'[N m]':>10}"
    )
    for bandwidth, rate in TUNINGS:
        lines.append(row(bandwidth, rate))
        print(lines[-1], flush=True)
    (Path(__file__).parent / "results" / "mpc_tuning.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
