"""How long things take, with the aims beside them.

    python benchmarks/speed.py

Prints the table and writes it to benchmarks/results/speed.txt.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

from machine import Machine, excitation, record  # noqa: E402

from diagnosis import diagnose  # noqa: E402
from identification.fit import fit  # noqa: E402
from plant import ServoModel  # noqa: E402
from plant.gears import GearTrain  # noqa: E402


def seconds(work: Callable[[], object], repeats: int) -> list[float]:
    taken = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        taken.append(time.perf_counter() - begin)
    return taken


def fresh(*command: str) -> Callable[[], object]:
    """A new process, as a user starts it."""
    return lambda: subprocess.run(command, check=True, capture_output=True)


def row(name: str, taken: list[float], aim: str) -> str:
    scale, unit = (1e3, "ms") if np.median(taken) < 0.1 else (1.0, "s")
    middle, worst = np.median(taken) * scale, max(taken) * scale
    return f"{name:52}{taken[0] * scale:10.3g}{middle:10.3g}{worst:10.3g} {unit:4}{aim:>10}"


def controller_steps() -> list[float]:
    """300 closed-loop steps of a sine at N = 30 [s each]."""
    from mpc import Controller

    sample_time = 0.005
    controller = Controller(
        ServoModel.paper(), GearTrain.paper(), sample_time=sample_time, horizon=30, min_torque=0.02, max_torque=0.3
    )
    taken = []
    for k in range(300):
        reference = 0.5 * np.sin(2 * np.pi * 0.5 * sample_time * (k + np.arange(31)))
        begin = time.perf_counter()
        controller.step(float(reference[0]), reference)
        taken.append(time.perf_counter() - begin)
    return taken


def main() -> None:
    minute = record(Machine(), excitation(0)).log()
    friction = Machine().hiding(coulomb_friction={"torque": 0.05})
    long = record(friction, excitation(1, duration=100.0)).log()
    lines = [
        f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
        f"{'':52}{'first':>10}{'median':>10}{'worst':>10} {'':4}{'aim':>10}",
        row("fit of J, alpha, K, gamma to 12,000 samples", seconds(lambda: fit(minute), 5), "0.5 s"),
        row("diagnosis of 20,000 samples, ten effects", seconds(lambda: diagnose(long), 2), "20 s"),
    ]
    try:
        lines.append(row("one step of the controller, N = 30", controller_steps(), ""))
    except ImportError:
        lines.append("one step of the controller: mpc has no Controller yet")
    imported = fresh(sys.executable, "-c", "import antidrive")
    helped = fresh(str(Path(sys.executable).with_name("antidrive")), "--help")
    lines.append(row("import antidrive (a whole process)", seconds(imported, 5), "1 s"))
    lines.append(row("antidrive --help", seconds(helped, 5), "0.5 s"))
    text = "\n".join(lines)
    print(text)
    folder = HERE / "results"
    folder.mkdir(exist_ok=True)
    (folder / "speed.txt").write_text(text + "\n")


if __name__ == "__main__":
    main()
