"""Speed of the rig: simulated seconds per second for one machine and for a thousand.

    python benchmarks/rig_speed.py

Prints the table and writes it to benchmarks/results/rig_speed.txt. The target is 1,000 machines times 10 s in under 60
s on 2 cores; processor time is given too, as other load on the computer does not affect it.
"""

from __future__ import annotations

import os
import platform
import time
from pathlib import Path

import numpy as np

from plant.fleet import Fleet
from plant.motion import motion
from plant.rig import Rig

SAMPLE_TIME = 0.005
DURATION = 10.0
FULL = {
    "supply_voltage": 36.0,
    "current_bandwidth": 500.0,
    "encoder_delay": 0.002,
    "motor_encoder_noise": 1e-4,
    "coulomb_friction": 0.2,
    "breakaway_excess": 0.1,
    "cogging_amplitude": 0.1,
    "cogging_order": 12.0,
}
"""All features of the rig are active."""


def seconds(machines: int) -> tuple[float, float]:
    """Time to simulate DURATION on that many machines, each with a different backlash [s]: wall clock, processor."""
    rng = np.random.default_rng(0)
    rigs = [Rig.paper_like(**FULL, backlash=float(gap)) for gap in rng.uniform(2e-4, 4e-3, machines)]
    output_torque = 2.0 * np.sin(2 * np.pi * 0.5 * np.arange(round(DURATION / SAMPLE_TIME)) * SAMPLE_TIME)
    torques = np.repeat(rigs[0].gears.pinion_torques(output_torque, 0.005)[:, None], machines, axis=1)
    fleet, begin, worked = Fleet(rigs), time.perf_counter(), time.process_time()
    record = fleet.run(torques, SAMPLE_TIME, range(machines))
    taken = time.perf_counter() - begin, time.process_time() - worked
    assert np.all(np.isfinite(record.angle))
    return taken


def main() -> None:
    compiled = motion(2).wait()
    lines = [
        f"{platform.machine()}, {os.cpu_count()} cores, {'machine code' if compiled else 'virtual machine'}, "
        f"fine step 20 us, sample {SAMPLE_TIME * 1e3:g} ms, load average {os.getloadavg()[0]:.1f} before",
        f"{'machines':>8}{'seconds':>10}{'of cores':>10}{'simulated s per s':>20}{'aim':>10}",
    ]
    for machines, aim in ((1, ""), (1000, "60 s")):
        taken, cores = seconds(machines)
        lines.append(f"{machines:8d}{taken:10.2f}{cores:10.2f}{machines * DURATION / taken:20.0f}{aim:>10}")
    text = "\n".join(lines)
    print(text)
    folder = Path(__file__).parent / "results"
    folder.mkdir(exist_ok=True)
    (folder / "rig_speed.txt").write_text(text + "\n")


if __name__ == "__main__":
    main()
