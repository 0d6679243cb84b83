"""Agreement of the closed form and the quadratic program of the torque allocation, and their computing times.

    python benchmarks/allocation_agreement.py

100,000 random cases at each of three scales: random gear trains, limits, weights, rotors, friction and rates, with
demands inside, outside and at the limit of the reachable torques. Prints the table and writes it to
benchmarks/results/allocation_agreement.txt.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

from machines import DT, best_by_trying, random_allocator, requests, two_drives  # noqa: E402

from allocation import Allocation, Allocator  # noqa: E402

CASES = 100_000
OF_EACH = 50  # cases per machine
OTHERS = ((1, 2), (2, 3), (2, 4), (3, 4))
OF_OTHERS = 500


def residual(result: Allocation) -> float:
    return max(result.primal_residual, result.dual_residual, result.duality_gap)


def two_drive_row(scale: float, cases: int, seed: int) -> str:
    """Largest difference of the two methods over the rated torque, and the results of the certificates."""
    rng = np.random.default_rng(seed)
    worst, proof, unsolved, differing = 0.0, 0.0, 0, 0
    seconds: dict[str | None, list[float]] = {None: [], "osqp": []}
    for _ in range(cases // OF_EACH):
        closed = two_drives(rng, scale)
        ways = (closed, replace(closed, solver="osqp"))
        for ask in requests(rng, closed, OF_EACH):
            results = []
            for way in ways:
                begin = time.perf_counter()
                results.append(way.allocate(ask.torque, ask.acceleration, before=ask.before, dt=DT))
                seconds[way.solver].append(time.perf_counter() - begin)
            apart = float(np.max(np.abs(results[0].torques - results[1].torques)) / np.max(closed.bounds.greatest))
            worst, differing = max(worst, apart), differing + (apart > 1e-9)
            proof = max(proof, *(residual(result) for result in results))
            unsolved += "not certified" in results[1].status
    closed_us, qp_us = (1e6 * float(np.median(taken)) for taken in seconds.values())
    return (
        f"{scale:10g}{cases:10d}{worst:16.1e}{differing:10d}{proof:14.1e}{unsolved:12d}{closed_us:12.0f}{qp_us:10.0f}"
    )


def other_row(n: int, m: int, cases: int, seed: int) -> str:
    """The same for other structures, compared with every set of active bounds."""
    rng = np.random.default_rng(seed)
    worst, proof, unsolved, seconds = 0.0, 0.0, 0, []
    for _ in range(cases):
        scale = 10 ** rng.uniform(-2, 2)
        allocator: Allocator = replace(random_allocator(rng, n, m, scale), solver="osqp")
        bounds, B = allocator.bounds, allocator.bounds.structure.pushing
        torque = scale * B @ rng.uniform(-0.2, 1.2, m)
        begin = time.perf_counter()
        result = allocator.allocate(torque)
        seconds.append(time.perf_counter() - begin)
        rated = float(np.max(bounds.greatest))
        lower, upper = np.minimum(bounds.floor, bounds.greatest) / rated, bounds.greatest / rated
        best = best_by_trying(B, torque / rated, lower, upper, np.array(allocator.weights))
        worst = max(worst, float(np.max(np.abs(result.torques / rated - best))))
        proof = max(proof, residual(result))
        unsolved += "not certified" in result.status
    middle = 1e6 * float(np.median(seconds))
    return f"{f'{n} x {m}':>10}{cases:10d}{worst:16.1e}{'':10}{proof:14.1e}{unsolved:12d}{'':12}{middle:10.0f}"


def main() -> None:
    columns = ("cases", "apart / rated", "> 1e-9", "worst proof", "OSQP failed", "closed us", "QP us")
    heads = "".join(f"{name:>{width}}" for name, width in zip(columns, (10, 16, 10, 14, 12, 12, 10), strict=True))
    lines = ["Two drives: closed form against quadratic program (OSQP, made exact), half of the cases with rates"]
    lines.append(f"{'N m':>10}{heads}")
    for seed, scale in enumerate((0.01, 1.0, 100.0)):
        lines.append(two_drive_row(scale, CASES, seed))
        print(lines[-1], flush=True)
    lines += ["Other structures: quadratic program against every set of active bounds", f"{'n x m':>10}{heads}"]
    lines += [other_row(n, m, OF_OTHERS, 10 * n + m) for n, m in OTHERS]
    text = "\n".join(lines)
    print(text)
    folder = HERE / "results"
    folder.mkdir(exist_ok=True)
    (folder / "allocation_agreement.txt").write_text(text + "\n")


if __name__ == "__main__":
    main()
