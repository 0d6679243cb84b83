"""Rates of right, honest and wrong diagnoses on randomly drawn machines.

    python benchmarks/field.py choosing [--count 100] [--processes 2] [--with module:function] [--out FOLDER]
    python benchmarks/field.py choosing --seeds 3,17        single logs
    python benchmarks/field.py choosing --table             the table of the stored outcomes

Draws logs of servos (`drawn_machines`), diagnoses each, and reports how often the diagnosis is right, honest or wrong
(`field_scoring`). *choosing* are 500 seeds for work on the method; *final* are 1,000 others, each run once; *later* are
2,000 more, for changes made after those. Each log runs in a separate process with a time limit. Outcomes are appended
to a file as they come, and stored ones are not run again. The table goes to benchmarks/results/field.txt.
"""

from __future__ import annotations

import argparse
import json
import sys
from functools import partial
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from drawn_machines import drawn  # noqa: E402
from field_outcome import Outcome, outcome_of  # noqa: E402
from field_scoring import score  # noqa: E402
from field_table import table  # noqa: E402
from field_workers import results  # noqa: E402

SETS = {"choosing": range(500), "final": range(100_000, 101_000), "later": range(101_000, 103_000)}
RESULTS = HERE / "results"


def main() -> None:
    a = arguments()
    seeds = [int(seed) for seed in a.seeds.split(",")] if a.seeds else list(SETS[a.set])[a.first :][: a.count]
    store = a.out / f"field_{a.set}_{a.method.replace(':', '_').replace('.', '_')}.jsonl"
    stored = kept(store)
    left = [] if a.table else [seed for seed in seeds if a.seeds or seed not in stored]
    work = partial(outcome_of, method=a.method, folder=a.logs)
    a.out.mkdir(parents=True, exist_ok=True)
    for seed, reported in results(left, work, a.processes, a.limit):
        outcome = reported if "truth" in reported else without_answer(seed, reported, a.logs)
        stored[seed] = outcome
        with store.open("a", encoding="utf-8") as file:
            file.write(json.dumps(outcome) + "\n")
        print(line(outcome), flush=True)
    shown = list(stored.values()) if a.table else [stored[seed] for seed in seeds if seed in stored]
    text = f"{len(shown)} logs of the set '{a.set}' ({a.method})\n\n{table(shown)}"
    print(text)
    if not a.seeds:
        (RESULTS / "field.txt" if a.out == RESULTS else store.with_suffix(".txt")).write_text(text + "\n")


def arguments() -> argparse.Namespace:
    """The command-line arguments."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", choices=SETS)
    parser.add_argument("--count", type=int, default=1000, help="how many seeds of the set")
    parser.add_argument("--first", type=int, default=0, help="at which place of the set to begin")
    parser.add_argument("--seeds", help="single seeds instead, separated by commas; run again if they are there")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument(
        "--limit", type=float, default=120.0, help="seconds of the processor after which a log counts as without end"
    )
    parser.add_argument("--with", dest="method", default="diagnosis:diagnose", help="module:function that diagnoses")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the outcomes")
    parser.add_argument("--logs", type=Path, default=None, help="folder in which drawn logs are kept")
    parser.add_argument("--table", action="store_true", help="only the table of all outcomes that are there")
    return parser.parse_args()


def kept(store: Path) -> dict[int, Outcome]:
    """The stored outcomes by seed, the last of each."""
    lines = store.read_text(encoding="utf-8").splitlines() if store.exists() else []
    return {outcome["seed"]: outcome for outcome in map(json.loads, lines)}


def without_answer(seed: int, given: Outcome, logs: Path | None) -> Outcome:
    """The outcome of a log whose process was terminated: its truth is drawn again."""
    made = drawn(seed, logs)
    facts = json.loads(json.dumps(made.facts()))
    return {**facts, "samples": int(made.channels["time"].size), **given}


def line(outcome: Outcome) -> str:
    """One log in one line."""
    found = score(outcome)
    truth = ", ".join(f"{h['name']}{'*' if h['name'] == outcome['left_out'] else ''}" for h in outcome["truth"]) or "-"
    names = [f"{n['effect']} {n['probability']:.2f}" for n in outcome.get("names", ())]
    text = outcome.get("failed") or f"{outcome['verdict']}: {', '.join(names) or '-'}"
    bad = f"  WRONG {', '.join(found.wrong)}" if found.wrong else ""
    part = f"  part {', '.join(found.part)}" if found.part else ""
    setting = f"{outcome['kind']}, {outcome['loop']}, rest {100 * outcome['rest_share']:g} %"
    return (
        f"{outcome['seed']:>6} {found.category:6} [{setting}] {truth} => {text}{bad}{part} ({outcome['seconds']:.1f} s)"
    )


if __name__ == "__main__":
    main()
