"""Backlash with flanks that are harder, softer or less damped than in the model: is it reported and measured correctly?

    python benchmarks/backlash_flanks.py [processes]

The simulated machine has by default the flanks of the model. Writes results/backlash_flanks.txt.
"""

from __future__ import annotations

import multiprocessing
import sys
from itertools import product
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

from machine import Machine, excitation, record  # noqa: E402

from diagnosis import diagnose  # noqa: E402

FLANKS = ((400.0, 0.5), (2000.0, 0.5), (150.0, 0.3), (400.0, 0.25), (1000.0, 0.1))  # frequency [rad/s], damping ratio
GAPS, SHARE, SEEDS = (0.005, 0.02), 0.3, (31, 32)  # [rad], [-]
DURATION, HELD_OUT = 30.0, 15.0  # [s]
Case = tuple[tuple[float, float], float, int]


def row_of(case: Case) -> str:
    """Result of the diagnosis of one backlash."""
    (frequency, damping), gap, seed = case
    machine = Machine(flank_frequency=frequency, flank_damping=damping)
    machine = machine.hiding(backlash={"gap": gap, "motor_share": SHARE})
    log, held_out = (
        record(machine, excitation(2 * seed + k, duration=seconds), seed=seed + k).log()
        for k, seconds in enumerate((DURATION, HELD_OUT))
    )
    found = diagnose(log, None, held_out)
    names = ", ".join(f"{cause.effect} {cause.probability:.3f}" for cause in found.causes) or "-"
    sizes = [cause.parameters["gap"] for cause in found.causes if cause.effect == "backlash"]
    size = "".join(f"{1e3 * line.value:6.2f} +- {1e3 * (line.std or 0.0):.2f}" for line in sizes)
    before, after = found.gain.held_out_rms_before, found.gain.held_out_rms_after
    error = f"{1e3 * before:7.2f} -> {1e3 * after:.2f}"
    return (
        f"{frequency:6.0f} {damping:8.2f} {1e3 * gap:6.0f} {seed:5}  {size:15} {error:17}  {found.verdict:10} {names}"
    )


def main() -> None:
    lines = ["flanks [rad/s], [-]  gap  seed  told [mrad]     held out [mrad]    verdict    names"]
    with multiprocessing.get_context("spawn").Pool(int(sys.argv[1]) if len(sys.argv) > 1 else 2) as pool:
        for line in pool.imap(row_of, product(FLANKS, GAPS, SEEDS)):
            print(line, flush=True)
            lines.append(line)
    lines.append(
        f"The motor has {SHARE:g} of the inertia; the model's flanks have 400 rad/s and 0.5 at first. Noise 1 mrad."
    )
    (HERE / "results" / "backlash_flanks.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
