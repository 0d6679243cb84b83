"""Ten confusable pairs and one more: what a plain chirp tells of them, and what the designed experiment does.

    python benchmarks/separating_experiments.py [seeds] [number of a pair ...]

An independent machine hides a little of the first of a pair and records a short, slow chirp; both models are fitted to
it. For that log the experiment is designed, played into the machine and recorded under several seeds of the noise, and
both models are refitted to all data. Prints the table and writes it to benchmarks/results/separating_experiments.txt.
"""

from __future__ import annotations

import multiprocessing
import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

from machine import Machine, chirp, record  # noqa: E402

from diagnosis import Limits, separating_experiment  # noqa: E402
from identification.fit import fit  # noqa: E402
from identification.fit_result import Fit  # noqa: E402
from identification.log import Log  # noqa: E402
from identification.problem import Problem  # noqa: E402
from plant import ServoModel, catalogue  # noqa: E402

LIMITS = Limits(torque=4.0, speed=5.0, travel=(-4.0, 4.0))
DURATION = 10.0
Values = Mapping[str, float]
PAIRS: tuple[tuple[str, Values, str, Values], ...] = (
    ("stribeck_friction", {"coulomb": 0.1, "excess": 0.01, "velocity": 0.3}, "coulomb_friction", {"torque": 0.1}),
    ("presliding_hysteresis", {"torque": 0.1, "stiffness": 60.0}, "coulomb_friction", {"torque": 0.1}),
    ("load_dependent_friction", {"coefficient": 0.006}, "coulomb_friction", {"torque": 0.006}),
    ("actuator_lag", {"time_constant": 0.005}, "input_delay", {"time": 0.005}),
    (
        "compliance",
        {"frequency": 70.0, "damping": 0.05, "motor_share": 0.3},
        "backlash",
        {"gap": 0.003, "motor_share": 0.3},
    ),
    (
        "gravity_offset",
        {"beta": 0.01},
        "encoder_eccentricity",
        {"amplitude": 0.005, "order": 1.0, "phase": 0.0},
    ),
    (
        "cable_stiffness",
        {"stiffness": 0.003, "cubic": 0.0, "rest_angle": 0.0},
        "asymmetric_friction",
        {"forward": 0.006, "backward": 0.003, "viscous_difference": 0.0},
    ),
    ("sensor_lag", {"time_constant": 0.005}, "input_delay", {"time": 0.005}),
    ("quadratic_drag", {"drag": 0.007}, "stribeck_friction", {"coulomb": 0.02, "excess": 0.02, "velocity": 0.5}),
    ("cable_stiffness", {"stiffness": 0.003, "cubic": 0.0, "rest_angle": 1.0}, "torque_offset", {"torque": 0.003}),
    (
        "cogging",
        {"amplitude": 0.003, "order": 5.0, "phase": 0.3},
        "encoder_eccentricity",
        {"amplitude": 0.0006, "order": 5.0, "phase": 0.3},
    ),
)
HEADER = (
    f"{'hidden':24}{'rival':24}{'log':>7}{'absorbed':>17}{'log odds, 10 s':>17}{'chirp':>8}{'half as':>9}"
    f"{'right with':>12}{'s':>7}\n"
    f"{'':24}{'':24}{'':>7}{'chirp':>8}{'design':>9}{'chirp':>8}{'design':>9}{'20 s':>8}{'long':>9}{'the design':>12}"
    f"{'design':>7}  signal"
)


def with_experiment(found: Fit, experiment: Log) -> Fit:
    """The refit to the log and the recorded experiment."""
    log = Log.merge([found.log, experiment])
    start = np.array([[experiment.runs[0].output[0], 0.0]])
    return Problem.of(log, found.model).descend(replace(found, initial=np.vstack((found.initial, start))))


def row(task: tuple[int, int]) -> tuple[bool, int, str]:
    """One pair: whether half the duration of a chirp does, how often the right one won, and the line of the table."""
    number, seeds = task
    hidden, values, other, wrong = PAIRS[number]
    machine = Machine().hiding(**{hidden: values})
    log = record(machine, chirp(3.0, 0.05, 1.0, 12.0, 0.005), seed=number).log()
    paper = ServoModel.paper()
    models = [paper.with_effect(catalogue[name](**given)) for name, given in ((hidden, values), (other, wrong))]
    first, second = (fit(log, model) for model in models)
    begin = time.perf_counter()
    best = separating_experiment(first, second, LIMITS, duration=DURATION)
    seconds = time.perf_counter() - begin
    longer = separating_chirp(first, second)
    right = 0
    for seed in range(seeds):
        played = record(machine, best.torque, seed=100 + seed, angle=best.start).log()
        refits = [with_experiment(found, played) for found in (first, second)]
        right += refits[0].log_likelihood > refits[1].log_likelihood
    half = best.separable and best.separation >= longer
    verdict = "yes" if half else "no" if best.separable else "neither"
    line = (
        f"{hidden:24}{other:24}{first.log_likelihood - second.log_likelihood:7.1f}"
        f"{best.chirp_absorbed:8.3f}{best.absorbed:9.3f}{best.chirp_separation:8.1f}{best.separation:9.1f}"
        f"{longer:8.1f}{verdict:>9}{f'{right} of {seeds}':>12}{seconds:7.1f}  {best.signal}"
    )
    return half, right, line


def separating_chirp(first: Fit, second: Fit) -> float:
    """Log odds of a plain chirp twice as long as the designed experiment."""
    from diagnosis.experiment.separation import Rival
    from diagnosis.experiment.signal_design import Design

    design = Design(
        rivals=(Rival.of(first), Rival.of(second)),
        limits=LIMITS,
        duration=2.0 * DURATION,
        sample_time=first.log.sample_time,
        start=float(first.initial[0, 0]),
    )
    found = design.plain_chirp()
    return found.log_odds if found is not None else 0.0


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    chosen = [int(place) for place in sys.argv[2:]] or list(range(len(PAIRS)))
    lines = [HEADER]
    print(HEADER)
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        results = []
        for result in pool.imap(row, [(number, seeds) for number in chosen]):
            results.append(result)
            lines.append(result[2])
            print(result[2], flush=True)
    lines.append(
        f"half the duration of a chirp does for {sum(r[0] for r in results)} of {len(results)} pairs; "
        f"the right one won {sum(r[1] for r in results)} of {seeds * len(results)} times"
    )
    print(lines[-1])
    folder = HERE / "results"
    folder.mkdir(exist_ok=True)
    (folder / "separating_experiments.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
