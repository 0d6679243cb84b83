"""Diagnoses of machines that nobody chose: inertia, gravity, friction, noise, commands and hidden shapes are random.

    python benchmarks/random_machine_diagnoses.py COUNT SEED [processes]
    python benchmarks/random_machine_diagnoses.py table

The calibration hides effects in one machine under one kind of command. Here every diagnosis has its own, and its log is
stretched in time and torque besides: nothing of the product may hang on the paper's numbers. COUNT diagnoses from SEED
on are added to benchmarks/results/random_machine_diagnoses.jsonl, a line each, which depends on its key alone; every
fourth log hides nothing. Sizes are stated in lambda as in `calibration`.
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

from calibration import answer, evidence_of_sets, held_out_errors, window_of  # noqa: E402
from calibration_table import honest, rate, shown, table  # noqa: E402
from effect_sizes import reaching  # noqa: E402
from hidden_effects import CASES, Hidden, evidence, oracle, rival_model  # noqa: E402
from random_machines import COMMANDS, Bench, shaped  # noqa: E402
from result_store import Key, add, attempted, stored  # noqa: E402

from diagnosis import diagnose  # noqa: E402

STORE = HERE / "results" / "random_machine_diagnoses.jsonl"
HELD_OUT = 15.0  # [s], before it is stretched
LAMBDAS = (100.0, 400.0)


def one(key: Key) -> dict[str, Any]:
    """One diagnosis: of an effect at a lambda, or of nothing hidden."""
    part, number, seed = key
    bench = Bench.drawn(seed)
    if part == "clean":
        begin = time.perf_counter()
        found = diagnose(bench.stretched(bench.log(bench.host, seed)), None)
        told = answer(found, time.perf_counter() - begin)
        return {"key": list(key), "truth": [], "kind": bench.commands, **told}
    case, wanted = shaped(CASES[number], bench, seed), LAMBDAS[seed // 4 % len(LAMBDAS)]
    size, reached = size_on(case, bench, seed, wanted)
    log = bench.log(case.machine(size), seed)
    held = bench.log(case.machine(size), seed + 1_000_000, duration=HELD_OUT)
    begin = time.perf_counter()
    found = diagnose(bench.stretched(log), case.base, bench.stretched(held))
    told = answer(found, time.perf_counter() - begin)
    best = oracle(case, size, log)
    window = window_of(best)
    ours = held_out_errors([found.base, found.extended], bench.stretched(held), window and window * bench.slower)
    return {
        "key": list(key),
        "truth": [case.effect],
        "kind": bench.commands,
        "wanted": wanted,
        "lambda": reached,
        "size": size,
        **told,
        **evidence_of_sets(found, case.effect),
        "oracle": best.log_likelihood - found.base.log_likelihood,
        "errors": [*ours, *held_out_errors([best], held, window)],
    }


def size_on(case: Hidden, bench: Bench, seed: int, wanted: float) -> tuple[float, float]:
    """The size of an effect that comes closest to a lambda on a log of the bench, with its own lambda."""

    def lambda_of(size: float) -> float:
        logs = [bench.log(case.machine(size), seed, sign=sign) for sign in (1.0, -1.0)]
        more = len(case.truth(size).names) - len(rival_model(case, size).names)
        return float(np.mean([evidence(case, size, log) for log in logs])) - more

    # Of a gap narrower than the noise only the give of its flanks would show.
    least = bench.noise if case.effect == "backlash" else case.sizes[0] / 1e3
    ((found, reached),) = reaching({wanted: case.sizes[1]}, lambda_of, (least, 3.0 * case.sizes[2])).values()
    return found, reached


def keys(count: int, first: int) -> list[Key]:
    """(part, number of the case, seed): every fourth log is clean, in the others an effect is hidden at random."""
    number = {seed: int(np.random.default_rng([seed, 24]).integers(len(CASES))) for seed in range(first, first + count)}
    return [("clean", 0, seed) if seed % 4 == 3 else ("hidden", number[seed], seed) for seed in number]


def page(told: list[dict[str, Any]]) -> str:
    """The calibration's tables, what was raised, and the rates by the kind of command."""
    lines = [table([t for t in told if "failed" not in t]), ""]
    hidden = [t for t in told if t.get("truth") and shown(t)]
    for kind in COMMANDS:
        of = [t for t in hidden if t["kind"] == kind]
        lines.append(f"{kind:26}alone or honestly ambiguous {rate(sum(map(honest, of)), len(of))}")
    lines += [f"seed {t['key'][2]}, {CASES[t['key'][1]].effect}: {t['failed']}" for t in told if "failed" in t]
    return "\n".join(lines)


def main() -> None:
    if sys.argv[1] != "table":
        count, first = int(sys.argv[1]), int(sys.argv[2])
        add(STORE, keys(count, first), partial(attempted, one), int(sys.argv[3]) if len(sys.argv) > 3 else 2)
    text = page(stored(STORE))
    (HERE / "results" / "random_machine_diagnoses.txt").write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
