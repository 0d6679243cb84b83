"""A controller through 125,000 faulty samples: measurements, references, estimates, solvers and drives that fail.

    python benchmarks/mpc_never_lost.py [samples]

At each sample the torques of the whole horizon must keep their bounds exactly and the status must be correct; after
each fault the controller must recover. Writes benchmarks/results/mpc_never_lost.txt.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from fault_injection import BACK, GEARS, MISHAPS, broken_promises, life

from mpc import Controller
from plant import ServoModel
from plant.effects import CoulombFriction, InputDelay

LIMITS: dict[str, Any] = {"angle_limits": (-0.5, 0.5), "speed_limit": 1.0, "torque_rate": 100.0, "motor_friction": 1e-3}
MODELS: dict[str, tuple[ServoModel, dict[str, Any]]] = {
    "the paper's plant": (ServoModel.paper(), {}),
    "heavy rotors": (ServoModel(), {"rotor_inertia": 1e-5}),
    "delay": (ServoModel().with_effect(InputDelay(time=0.012)), {}),
    "friction": (ServoModel().with_effect(CoulombFriction(torque=0.1)), {}),
    "limits": (ServoModel(), LIMITS),
}


def lived(name: str, count: int) -> list[str]:
    """Lines for a controller through a number of faulty samples."""
    model, options = MODELS[name]
    controller = Controller(model, GEARS, **options)
    broken, met, back = Counter[str](), Counter[str](), dict.fromkeys(MISHAPS, 0)
    total, degraded, mishap = 0, 0, ""
    for sample in life(model, controller, seed=2):
        if sample.mishap and met.total() == count:
            break
        broken.update(broken_promises(controller, sample))
        total, degraded = total + 1, degraded + (sample.control.status != "optimal")
        if sample.mishap:
            mishap = sample.mishap
            met[mishap] += 1
        elif mishap and abs(sample.error) < BACK and sample.control.status == "optimal":
            back[mishap], mishap = max(back[mishap], sample.calm), ""
    lines = [f"{name}: {count} samples of mishaps among {total}, {degraded} degraded, {broken.total()} promises broken"]
    lines += [f"  {number} x {what}" for what, number in broken.items()]
    return lines + [f"  {what:22}{met[what]:7d} samples, back after {back[what]:5d} at most" for what in MISHAPS]


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 125_000
    lines = []
    for name in MODELS:
        lines += [*lived(name, count // len(MODELS)), ""]
        print("\n".join(lines[-len(MISHAPS) - 2 :]), flush=True)
    folder = Path(__file__).parent / "results"
    folder.mkdir(exist_ok=True)
    (folder / "mpc_never_lost.txt").write_text("\n".join(lines[:-1]) + "\n")


if __name__ == "__main__":
    main()
