"""Every log must end in a result or in a one-sentence error: test with randomly drawn machines, commands and faults.

    python benchmarks/logs_of_any_scale.py [logs] [processes] [most samples of a log] [fits]

With `fits` the diagnosis is left out. Prints a line for each failure, and the table. The table is written to
benchmarks/results/rough_logs.txt, or rough_fits.txt, also at intervals during the run.
"""

from __future__ import annotations

import multiprocessing
import subprocess
import sys
from collections import Counter
from functools import partial
from pathlib import Path

HERE = Path(__file__).parent
_SAVED = 50  # logs between two writes of the table
sys.path.insert(0, str(HERE.parent / "tests"))

from rough_log_outcome import Tried, diagnosed, identified  # noqa: E402
from rough_logs import RoughLog, rough_log  # noqa: E402


def tried(seed: int, longest: int, both: bool) -> tuple[RoughLog, *tuple[Tried, ...]]:
    rough = rough_log(seed, longest=longest)
    return (rough, identified(rough), diagnosed(rough)) if both else (rough, identified(rough))


def table(what: str, results: list[tuple[RoughLog, Tried]]) -> str:
    """Counts of outcomes and of failures, and the slowest log."""
    outcomes = Counter(":".join(t.outcome.split(":")[:2])[:110] for _, t in results)
    faults = Counter(fault.split(":")[0] for _, t in results for fault in t.faults)
    slowest = max(results, key=lambda pair: pair[1].seconds / pair[1].allowed)
    total = sum(t.seconds for _, t in results)
    return "\n".join(
        (
            f"{what}: {len(results)} logs, {sum(bool(t.faults) for _, t in results)} at fault, "
            f"{total:.0f} s of processor time",
            *(f"  {count:5} {outcome}" for outcome, count in outcomes.most_common()),
            *(f"  {count:5} FAULT {fault}" for fault, count in faults.most_common()),
            f"  nearest to its limit: {slowest[1].seconds:.1f} s of {slowest[1].allowed:.1f} s ({slowest[0]})",
        )
    )


def tables(results: list[tuple[RoughLog, *tuple[Tried, ...]]], of: str) -> str:
    """Results of the fits and the diagnoses so far."""
    parts = [table("identify", [(found[0], found[1]) for found in results])]
    if len(results[0]) > 2:
        parts.append(table("diagnose with two candidates", [(found[0], found[2]) for found in results]))
    return "\n".join((f"{len(results)} rough logs {of}", *parts))


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    processes = int(sys.argv[2]) if len(sys.argv) > 2 else 2
    longest = int(sys.argv[3]) if len(sys.argv) > 3 else 50_000
    both = "fits" not in sys.argv[4:]
    work = partial(tried, longest=longest, both=both)
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=HERE, capture_output=True, text=True)
    of, path = commit.stdout.strip(), HERE / "results" / ("rough_logs.txt" if both else "rough_fits.txt")
    path.parent.mkdir(exist_ok=True)
    results: list[tuple[RoughLog, *tuple[Tried, ...]]] = []
    with multiprocessing.get_context("spawn").Pool(processes, maxtasksperchild=50) as pool:
        for done, found in enumerate(pool.imap_unordered(work, range(count)), start=1):
            results.append(found)
            for what, one in zip(("identify", "diagnose"), found[1:], strict=False):
                if one.faults:
                    print(f"{done}/{count} {what} {found[0]}: {'; '.join(one.faults)}", flush=True)
            if done % _SAVED == 0 or done == count:
                path.write_text(tables(results, f"of 50 to {longest} samples on commit {of}") + "\n")
    print(path.read_text())


if __name__ == "__main__":
    main()
