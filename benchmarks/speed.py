"""Computing times, compared with their targets.

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

from hidden_effects import CASES  # noqa: E402
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
    """A new process, as started by a user."""
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


def diagnoses() -> list[str]:
    """Twenty thousand samples and the whole catalogue: each effect at its middle size, in one process."""
    taken = []
    for number, case in enumerate(CASES):
        log = record(case.machine(case.sizes[1]), excitation(number, duration=100.0), seed=number).log()
        taken += seconds(lambda log=log, case=case: diagnose(log, case.base), 1)
        print(f"  {case.effect}: {taken[-1]:.1f} s", flush=True)
    again = seconds(lambda: diagnose(log, case.base), 1)
    return [
        row(f"diagnosis of 20,000 samples, {len(taken)} effects, one each", taken, "5 s"),
        f"{'  of these 95 % took less than':52}{np.quantile(taken, 0.95):30.3g} {'s':4}{'15 s':>10}",
        row("  the last of them once more", again, ""),
    ]


def million() -> str:
    """A million samples in a separate process, with its peak memory."""
    program = (
        "import resource, sys; sys.path.insert(0, sys.argv[1]);"
        "from machine import Machine, excitation, record; from diagnosis import diagnose; import time;"
        "machine = Machine().hiding(coulomb_friction={'torque': 0.05});"
        "log = record(machine, excitation(1, duration=1000.0, sample_time=1e-3), seed=1, sample_time=1e-3).log();"
        "begin = time.perf_counter(); found = diagnose(log); taken = time.perf_counter() - begin;"
        "print(taken, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20, found.causes[0].effect)"
    )
    result = subprocess.run(
        [sys.executable, "-c", program, str(HERE.parent / "tests")], check=True, capture_output=True
    )
    taken, memory, effect = result.stdout.decode().split()[-3:]
    name = f"diagnosis of 1,000,000 samples, {effect}"
    return f"{name:52}{float(taken):30.3g} {'s':4}{'120 s':>10}, {float(memory):.2g} GiB of 4"


def main() -> None:
    minute = record(Machine(), excitation(0)).log()
    lines = [
        f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
        f"{'':52}{'first':>10}{'median':>10}{'worst':>10} {'':4}{'aim':>10}",
        row("fit of J, alpha, K, gamma to 12,000 samples", seconds(lambda: fit(minute), 5), "0.5 s"),
        *diagnoses(),
        million(),
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
