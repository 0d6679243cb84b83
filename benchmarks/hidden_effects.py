"""Hide each effect at three sizes, diagnose, and compare with an oracle that knows which effect it is.

    python benchmarks/hidden_effects.py [clean logs] [seed]

Prints the table and writes it to benchmarks/results/hidden_effects.txt.
"""

from __future__ import annotations

import multiprocessing
import sys
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

from hidden import CASES, evidence, logs_of, oracle  # noqa: E402
from machine import Machine  # noqa: E402

from diagnosis import diagnose  # noqa: E402
from identification.fit_result import Fit  # noqa: E402
from identification.log import Log  # noqa: E402
from identification.simulation import free_simulation  # noqa: E402

HEADER = (
    f"{'effect':20}{'size':>9}{'lambda':>8}  {'verdict':16}{'named':44}{'prob.':>7}"
    f"{'size found / true':>24}{'gain':>8}{'oracle':>8}{'s':>7}"
)


def held_out_error(found: Fit, log: Log) -> float:
    """RMS error of a free simulation of the held-out run [rad]."""
    simulated = free_simulation(log, found.model)[0]
    return float(np.sqrt(np.mean((simulated - log.runs[0].output) ** 2)))


def row(task: tuple[int, int, int]) -> tuple[bool, bool, str]:
    """One effect at one size: whether it alone was named, whether it is among at most three, the line of the table."""
    number, place, seed = task
    case = CASES[number]
    size = case.sizes[place]
    log, held_out = logs_of(case.machine(size), seed=seed)
    begin = time.perf_counter()
    found = diagnose(log, case.base, held_out)
    seconds = time.perf_counter() - begin
    names = [cause.effect for cause in found.causes]
    first = bool(names) and names[0] == case.effect
    probability = f"{found.causes[0].probability:.3f}" if names else "-"
    sizes = "-"
    if first:
        pairs = [found.causes[0].parameters[name].value / case.at(size)[name] for name in case.judged]
        sizes = ", ".join(f"{pair:.3f}" for pair in pairs)
    errors = [held_out_error(f, held_out) for f in (found.base, found.extended, oracle(case, size, log))]
    gains = [1.0 - error / errors[0] for error in errors[1:]]
    rivals = [name for cause in found.causes for name, _ in cause.alternatives]
    honest = found.verdict == "ambiguous" and len(names) == 1 and len(rivals) <= 2 and case.effect in names + rivals
    alone = found.verdict == "named" and names == [case.effect]
    named = " or ".join(names + rivals) if honest else ", ".join(names) or "-"
    line = (
        f"{case.effect:20}{size:9.3g}{evidence(case, size, log):8.0f}  {found.verdict:16}{named:44}"
        f"{probability:>7}{sizes:>24}{gains[0]:8.3f}{gains[1]:8.3f}{seconds:7.1f}"
    )
    return alone, alone or honest, line


def clean(seed: int) -> tuple[bool, str]:
    """One log of the paper's machine with nothing hidden: whether something was named, and what."""
    log, held_out = logs_of(Machine(), seed=seed)
    found = diagnose(log, None, held_out)
    names = ", ".join(cause.effect for cause in found.causes)
    return found.verdict != "nothing_missing", f"  seed {seed}: {found.verdict} {names}"


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 11
    lines = [HEADER]
    print(HEADER)
    tasks = [(number, place, seed + place) for number in range(len(CASES)) for place in range(3)]
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        results = []
        for result in pool.imap(row, tasks):
            results.append(result)
            lines.append(result[2])
            print(result[2], flush=True)
        false = [text for wrong, text in pool.imap(clean, range(1000, 1000 + count)) if wrong]
    lines.append(
        f"{sum(r[0] for r in results)} of {len(tasks)} named alone, {sum(r[1] for r in results)} alone or among at "
        f"most three that cannot be told apart; {len(false)} of {count} clean logs were given a name or doubt"
    )
    lines += false
    print("\n".join(lines[len(tasks) + 1 :]))
    folder = HERE / "results"
    folder.mkdir(exist_ok=True)
    (folder / "hidden_effects.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
