"""Accuracy of the backlash from a preload sweep (is it within 5 %?), and coverage of its standard error, on the rig.

    python benchmarks/lost_motion.py [machines]

Each row is a fleet of machines with different gravity torques, and thus with different positions within a count of
their encoder. Prints the table and writes it to benchmarks/results/lost_motion.txt.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from antidrive.experiments.preload_sweep import Sweep, logs_of
from identification import Log, LostMotion, Unidentifiable, lost_motion
from plant.fleet import Fleet
from plant.gears import GearTrain
from plant.rig import Rig

ARCMIN = np.pi / 180 / 60
SLOW = 1e-4  # [rad/s]
# backlash [arcmin], bits at the load, bits at the motors, noise [rad], speed of the load [rad/s], visits of 2 s
ROWS = (
    (0.1, 17, 17, 1e-6, SLOW, 20),
    (0.1, 17, 17, 5e-6, SLOW, 20),
    (0.1, 17, 17, 5e-6, SLOW, 4),
    (0.1, 17, 17, 5e-6, 0.0, 20),
    (0.1, 17, 17, 1e-6, 0.0, 20),
    (0.1, 17, 17, 2e-5, 0.0, 20),
    (0.1, 17, 12, 5e-6, SLOW, 20),
    (0.1, 20, 20, 5e-6, SLOW, 20),
    (0.1, 23, 23, 5e-6, SLOW, 20),
    (1.0, 17, 17, 5e-6, SLOW, 4),
    (20.0, 17, 17, 5e-6, SLOW, 4),
)


def fleet(count: int, gap: float, bits: int, motor_bits: int, noise: float) -> Fleet:
    rng = np.random.default_rng(7)
    machines = [
        Rig.paper_like(
            gravity=rng.uniform(0.2, 0.5),
            backlash=gap * ARCMIN,
            encoder_counts=2**bits,
            motor_encoder_counts=2**motor_bits,
            encoder_noise=noise,
            mesh_friction=0.05,
        )
        for _ in range(count)
    ]
    return Fleet(machines)


def measured(log: Log, gears: GearTrain) -> LostMotion | None:
    try:
        return lost_motion(log, gears)
    except Unidentifiable:
        return None


def row_of(answers: list[LostMotion | None], gap: float) -> str:
    found = [each for each in answers if each is not None]
    lines = np.array([(each.drives[0].gap.value, each.drives[0].gap.std) for each in found])
    error, std = lines[:, 0] / gap - 1.0, lines[:, 1] / gap
    within, covered = np.mean(np.abs(error) < 0.05), np.mean(np.abs(error) < 1.96 * std)
    rms, score = np.sqrt(np.mean(error**2)), np.sqrt(np.mean((error / std) ** 2))
    text = f"{len(found) / len(answers):7.0%}{100 * np.median(std):9.2f}{100 * rms:9.2f}"
    return f"{text}{within:10.0%}{covered:10.0%}{score:8.2f}"


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    head = f"{'gap':>6}{'bits':>7}{'motors':>8}{'noise':>8}{'speed':>8}{'time':>6}"
    text = [
        f"{count} machines a row, preload 0.6 to 8 N m and back in 2 s, 1 kHz; 95 % intervals",
        f"{head}{'told':>7}{'std':>9}{'rms':>9}{'within':>10}{'covered':>10}{'rms of':>8}",
        f"{'[arcmin]':>8}{'':13}{'[urad]':>8}{'[urad/s]':>8}{'   [s]':13}{'[%]':>9}{'[%]':>9}{'5 %':>10}{'score':>18}",
    ]
    for gap, bits, motor_bits, noise, load_speed, visits in ROWS:
        sweep = Sweep(
            least=0.6, greatest=8.0, visit=2.0, visits=visits, sample_time=1e-3, stiffness=2000.0, damping=90.0
        )
        machines = fleet(count, gap, bits, motor_bits, noise)
        logs = logs_of(machines, sweep, load_speed=load_speed, seed=11)
        found = [measured(log, rig.gears) for log, rig in zip(logs, machines.rigs, strict=True)]
        row = f"{gap:6g}{bits:7d}{motor_bits:8d}{1e6 * noise:8g}{1e6 * load_speed:8g}{2 * visits:6d}"
        text.append(row + row_of(found, gap * ARCMIN))
        print(text[-1], flush=True)
    Path(__file__).with_name("results").joinpath("lost_motion.txt").write_text("\n".join(text) + "\n")


if __name__ == "__main__":
    main()
