"""Rate of false reports that runs disagree, with a complete model and with a missing effect.

Three runs of one machine, each with a different excitation and all with the same parameters, are fitted by the base
model. The machine has no hidden effect, or one that the base model lacks. The last lines have different payloads.

    PYTHONPATH=tests python benchmarks/run_disagreement.py [machines of each kind]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from machine import Machine, excitation, record

from identification import fit
from identification.between_run_differences import between_run_differences
from plant import ServoModel
from plant.effects import DeadZone

RUNS, SECONDS = 3, 12.0
HIDDEN: dict[str, dict[str, dict[str, float]]] = {
    "nothing": {},
    "Coulomb friction 0.1 N m": {"coulomb_friction": {"torque": 0.1}},
    "Coulomb friction 0.5 N m": {"coulomb_friction": {"torque": 0.5}},
    "quadratic drag": {"quadratic_drag": {"drag": 0.1}},
    "gravity offset": {"gravity_offset": {"beta": 0.3}},
    "cogging": {"cogging": {"amplitude": 0.3, "order": 6.0, "phase": 0.5}},
    "actuator lag": {"actuator_lag": {"time_constant": 0.02}},
    "torque offset": {"torque_offset": {"torque": 0.3}},
}


def finding(machine: Machine, seed: int, scales: tuple[float, ...]) -> str | None:
    """The reported differences between the runs of a machine, None if there are none."""
    commands = [s * excitation(RUNS * seed + run, duration=SECONDS) for run, s in zip(range(RUNS), scales, strict=True)]
    log = record(machine, np.column_stack(commands), seed=seed, angle=np.full(RUNS, -np.pi / 2)).log_of_runs()
    start = ServoModel(inertia=1.0, gravity=0.0, viscous_friction=0.1, effects=(DeadZone(half_width=0.0),))
    return between_run_differences(fit(log, start))


def main(count: int) -> str:
    """The table."""
    lines = [f"{'machine':<32} same excitation  amplitudes 0.5, 1, 2   ({count} logs each)"]
    for name, effects in HIDDEN.items():
        machine = Machine(inertia=2.0, gravity=0.5, viscous_friction=0.8, effects=effects)
        found = [
            sum(finding(machine, seed, scales) is not None for seed in range(count))
            for scales in ((1.0, 1.0, 1.0), (0.5, 1.0, 2.0))
        ]
        lines.append(f"{name:<32} {found[0]:>8} of {count} {found[1]:>12} of {count}")
        print(lines[-1], flush=True)
    for share in (0.01, 0.05, 0.3):
        machine = Machine(inertia=2.0 * (1.0 + share * np.arange(RUNS)), gravity=0.5, viscous_friction=0.8, effects={})
        hits = [finding(machine, seed, (1.0, 1.0, 1.0)) for seed in range(count)]
        right = sum(hit is not None and "about inertia" in hit for hit in hits)
        lines.append(f"inertia differs by {100 * share:.0f} %: inertia named in {right} of {count}")
        print(lines[-1], flush=True)
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    table = main(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
    target = Path(__file__).parent / "results" / "run_disagreement.txt"
    target.parent.mkdir(exist_ok=True)
    target.write_text(table)
