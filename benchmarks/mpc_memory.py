"""Memory use of a controller over many steps.

    python benchmarks/mpc_memory.py [steps]

Prints the resident memory of the process at ten instants and writes benchmarks/results/mpc_memory.txt.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path

from mpc import Controller
from plant import GearTrain, ServoModel


def resident() -> int:
    """Memory of this process in RAM [kB] (Linux)."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS"))


def main() -> None:
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000_000
    controller = Controller(ServoModel.paper(), GearTrain.paper())
    angle, degraded = 0.0, 0
    lines = [f"{steps} steps at N = {controller.horizon}, machine code: {controller.compiled}"]
    begin = time.perf_counter()
    for k in range(steps + 1):
        if k % (steps // 10) == 0:
            lines.append(f"{k:10d} steps {resident():8d} kB {time.perf_counter() - begin:8.1f} s")
            print(lines[-1], flush=True)
        control = controller.step(angle, 0.2 * math.sin(1e-3 * k))
        degraded += control.status != "optimal"
        angle = float(control.predicted_angle[1])
    lines.append(f"{degraded} steps degraded")
    print(lines[-1])
    folder = Path(__file__).parent / "results"
    folder.mkdir(exist_ok=True)
    (folder / "mpc_memory.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
