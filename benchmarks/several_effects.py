"""Two or three effects at once in randomly drawn machines.

    python benchmarks/several_effects.py COUNT SEED [processes]
    python benchmarks/several_effects.py table

The calibration hides twelve chosen pairs and triples in one machine. Here machine, commands and noise are randomly
drawn, and two or three effects, none of which is known to be confused with another. Each has a lambda of 200 alone.
COUNT diagnoses from SEED on are added to benchmarks/results/several_effects.jsonl, one per line, which depends on its
key only.
"""

from __future__ import annotations

import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

from calibration import answer, held_out_errors, window_of  # noqa: E402
from calibration_table import table  # noqa: E402
from effect_sizes import reaching  # noqa: E402
from hidden_effects import CASES, Hidden, alternative_model, evidence  # noqa: E402
from machine import Machine  # noqa: E402
from random_machines import Bench, shaped  # noqa: E402
from result_store import Key, add, attempted, stored  # noqa: E402

from diagnosis import diagnose  # noqa: E402
from identification.fit import fit  # noqa: E402
from identification.fit_result import Fit  # noqa: E402
from identification.log import Log  # noqa: E402
from identification.problem import Problem  # noqa: E402
from plant.effects import catalogue  # noqa: E402

STORE = HERE / "results" / "several_effects.jsonl"
WANTED = 200.0  # lambda of each effect alone
HELD_OUT = 15.0  # [s], before scaling of the time


def drawn(seed: int) -> list[Hidden]:
    """Two or three randomly drawn effects; the dead zone is part of the machine."""
    rng = np.random.default_rng([seed, 25])
    chosen: list[Hidden] = []
    for place in rng.permutation(len(CASES)):
        effect = catalogue[CASES[place].effect]
        confused = any(
            c.effect in effect.confused_with or effect.name in catalogue[c.effect].confused_with for c in chosen
        )
        if effect.name != "dead_zone" and not confused:
            chosen.append(CASES[place])
        if len(chosen) == 2 + seed % 2:
            break
    return chosen


def size_on(case: Hidden, bench: Bench, seed: int) -> float:
    """The size of an effect that comes closest to that lambda on a log of the bench."""

    def lambda_of(size: float) -> float:
        logs = [bench.log(case.machine(size), seed, sign=sign) for sign in (1.0, -1.0)]
        more = len(case.truth(size).names) - len(alternative_model(case, size).names)
        return float(np.mean([evidence(case, size, log) for log in logs])) - more

    # With a backlash narrower than the noise, only the compliance of its flanks would show.
    least = bench.noise if case.effect == "backlash" else case.sizes[0] / 1e3
    ((found, _),) = reaching({WANTED: case.sizes[1]}, lambda_of, (least, 3.0 * case.sizes[2])).values()
    return found


def one(key: Key) -> dict[str, Any]:
    """One diagnosis; `shown` is the lambda of each effect given the others."""
    _, _, seed = key
    bench = Bench.drawn(seed)
    cases = [shaped(case, bench, seed) for case in drawn(seed)]
    values = {case.effect: case.at(size_on(case, bench, seed)) for case in cases}
    machine: Machine = bench.host.hiding(**values)
    log = bench.log(machine, seed)
    held = bench.log(machine, seed + 1_000_000, duration=HELD_OUT)
    best = _fitted(log, cases, values)
    beside = {case.effect: 2.0 * (best.log_likelihood - _without(best, case.effect)) for case in cases}
    begin = time.perf_counter()
    found = diagnose(bench.stretched(log), None, bench.stretched(held))
    reported = answer(found, time.perf_counter() - begin)
    window = window_of(best)
    ours = held_out_errors([found.base, found.extended], bench.stretched(held), window and window * bench.slower)
    errors = [*ours, *held_out_errors([best], held, window)]
    return {
        "key": list(key),
        "kind": bench.commands,
        "truth": list(values),
        "shown": beside,
        **reported,
        "errors": errors,
    }


def _fitted(log: Log, cases: list[Hidden], values: dict[str, dict[str, float]]) -> Fit:
    """The true model, fitted from the true values."""
    truth = cases[0].start
    for case in cases:
        truth = truth.with_effect(catalogue[case.effect](**values[case.effect]))
    begin = fit(log, truth, fixed=[name for name in truth.names if name != "inertia"])
    return Problem.of(log, truth).descend(begin)


def _without(best: Fit, effect: str) -> float:
    return Problem.of(best.log, best.model.without_effect(effect)).descend(best).log_likelihood


def page(given: list[dict[str, Any]]) -> str:
    """The calibration's tables, increased validation errors, and errors raised."""
    lines = [table([t for t in given if "failed" not in t])]
    for t in given:
        if "failed" in t:
            lines.append(f"seed {t['key'][2]}: {t['failed']}")
            continue
        before, after, oracle = t["errors"]
        if after > 1.2 * oracle:
            lines.append(f"seed {t['key'][2]}: held out {before:.3g} -> {after:.3g} rad, oracle {oracle:.3g}")
    return "\n".join(lines)


def main() -> None:
    if sys.argv[1] != "table":
        count, first = int(sys.argv[1]), int(sys.argv[2])
        keys: list[Key] = [("several", 0, seed) for seed in range(first, first + count)]
        add(STORE, keys, partial(attempted, one), int(sys.argv[3]) if len(sys.argv) > 3 else 2)
    text = page(stored(STORE))
    (HERE / "results" / "several_effects.txt").write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
