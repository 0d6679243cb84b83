"""Diagnoses of the public logs of real machines, each with the split that its reader defines in advance.

    python benchmarks/real_logs.py FOLDER [name ...]

FOLDER holds a folder for each data set: emps, ur10e, hsm150, bam_xl330, kscale_sts3215. Names are those of
`antidrive diagnose --dataset`, with :K for the joint of a robot; by default all but kscale, which takes long. Prints
verdict, effects with their probabilities, and errors on estimation and validation data; writes results/real_logs.txt.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from diagnosis import Diagnosis, diagnose
from identification.datasets import load_dataset
from identification.log import Log
from identification.simulation import free_simulation
from plant.effects.nonparametric_curve import Nonparametric
from plant.servo import ServoModel

FOLDERS = {"bam": "bam_xl330", "kscale": "kscale_sts3215"}
BY_DEFAULT = ("emps", "ur10e:1", "ur10e:2", "ur10e:3", "hsm150", "bam")


def mean_absolute_error(log: Log, model: ServoModel) -> float:
    """Mean absolute error of a free simulation of whole runs [rad or m]."""
    simulated = free_simulation(log, model)
    return float(
        np.mean(np.concatenate([np.abs(s - r.output)[r.valid] for s, r in zip(simulated, log.runs, strict=True)]))
    )


def summary_lines(found: Diagnosis, held_out: Log) -> list[str]:
    """Verdict, reported effects and errors."""
    lines: list[str] = [found.verdict]
    for cause in found.causes:
        others = "".join(f", or {name} {p:.2f}" for name, p in cause.alternatives if p >= 0.01)
        values = ", ".join(
            f"{name} {e.value:.4g} +- {e.std:.2g} {e.unit}" if e.std is not None else f"{name} {e.value:.4g} {e.unit}"
            for name, e in cause.parameters.items()
        )
        lines.append(f"  {cause.effect} {cause.probability:.3f}{others}: {values}")
    curves = [effect.name for effect in found.model.effects if isinstance(effect, Nonparametric)]
    if found.unexplained.depends_on or curves:
        lines.append(
            f"  unexplained over {', '.join(found.unexplained.depends_on)}; carried: {', '.join(curves) or 'none'}"
        )
    lines += [f"  small: {m.effect} {m.probability:.3f}, {m.rms:.3g} rms" for m in found.minor]
    lines += [f"  set {', '.join(s.effects) or '-'} {s.probability:.3f}" for s in found.sets[:3]]
    error, gain = found.torque_error, found.gain
    of = "of the torque" if found.base.log.response == "torque" else "in simulation"
    lines += [
        f"  inverse error, fitted   {100 * error.estimation_before:6.2f} -> {100 * error.estimation_after:5.2f} %",
        f"  inverse error, held out {100 * error.held_out_before:6.2f} -> {100 * error.held_out_after:5.2f} %",
        f"  rms {of}, held out {gain.held_out_rms_before:.4g} -> {gain.held_out_rms_after:.4g} {gain.unit}"
        + (f", restarted every {gain.window:g} s" if gain.window else ""),
    ]
    if not gain.window and found.base.log.response != "torque":
        before, after = (mean_absolute_error(held_out, model) for model in (found.base.model, found.model))
        lines.append(f"  mean absolute error in simulation, held out {before:.4g} -> {after:.4g} {gain.unit}")
    return [*lines, *(f"  {warning}" for warning in found.warnings)]


def main() -> None:
    folder = Path(sys.argv[1])
    lines = []
    for wanted in sys.argv[2:] or BY_DEFAULT:
        name, _, joint = wanted.partition(":")
        data = load_dataset(name, folder / FOLDERS.get(name, name), joint=int(joint) if joint else None)
        begin = time.process_time()
        found = diagnose(data.estimation, data.base, data.holdout, fixed=data.fixed, inverse=data.inverse)
        seconds = time.process_time() - begin
        if data.holdout is None:
            raise SystemExit(f"{name} states no split")
        lines += [
            f"{wanted} ({seconds:.0f} s): {(lines_of := summary_lines(found, data.holdout))[0]}",
            *lines_of[1:],
            "",
        ]
        print("\n".join(lines[-len(lines_of) - 1 :]), flush=True)
    (Path(__file__).parent / "results" / "real_logs.txt").write_text("\n".join(lines))


if __name__ == "__main__":
    main()
