"""Random programmes of the controller against an independent solver, from hostile starts, and how long they take.

    python benchmarks/mpc_programmes.py [count]

Half of them have random dynamics, half are a servo far from where it should be, whose active set may cycle. Each starts
from a random guess of the active bounds. Needs DAQP (`pip install 'antidrive[bench]'`) and a C compiler. DAQP's answers
are certified too: where it is not optimal, a third solver decides. Writes benchmarks/results/mpc_programmes.txt.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import daqp
import numpy as np
from scipy.optimize import lsq_linear

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from programmes import Array, Solver, Stages, random_stages, servo_stages

WRONG = 1e-6  # of the range of the torques
SHAPES = ((2, 20), (2, 50), (3, 30), (4, 30))  # states, samples


def violation(H: Array, g: Array, stages: Stages, e: Array) -> float:
    """Of the optimality conditions, in the unit of e."""
    moved = np.clip(e - (H @ e + g) / np.diag(H), stages.low, stages.high)
    return float(np.max(np.abs(e - moved)))


def by_daqp(H: Array, g: Array, stages: Stages) -> Array:
    scale = 1.0 / np.max(np.diag(H))
    size = g.size
    return np.array(daqp.solve(scale * H, scale * g, np.zeros((0, size)), stages.high.copy(), stages.low.copy())[0])


def by_least_squares(R: Array, target: Array, stages: Stages) -> Array:
    free = stages.high > stages.low
    e = np.where(free, 0.0, stages.low)
    box = (stages.low[free], stages.high[free])
    e[free] = lsq_linear(R[:, free], target - R @ e, box, method="bvls", tol=1e-15, max_iter=5000).x
    return e


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    lines = [f"{count} programmes against DAQP", ""]
    lines.append(
        f"{'states':>8}{'N':>5}{'programmes':>12}{'uncertified':>13}{'wrong':>7}{'largest difference':>20}"
        f"{'DAQP wrong':>12}{'median [us]':>13}{'99 %':>8}{'99.9 %':>8}{'max':>8}"
    )
    for n, N in SHAPES:
        solver, rng = Solver(n, N), np.random.default_rng(n * 1000 + N)
        each = count // len(SHAPES)
        times, worst, wrong, uncertified, theirs_wrong = np.empty(each), 0.0, 0, 0, 0
        for k in range(each):
            hardness = rng.uniform(0, 4)
            stages = random_stages(rng, n, N, hardness) if k % 2 or n > 2 else servo_stages(rng, N, hardness)
            guess = rng.integers(-1, 2, N)
            answers = []
            for repeat in range(3):  # the least: the machine may be busy with other things
                solver.load(stages, guess)
                begin = time.perf_counter()
                residual = solver.machine_code()
                took = time.perf_counter() - begin
                times[k] = took if repeat == 0 else min(times[k], took)
                answers.append(solver.arrays["e"].copy())
            ours = answers[0]
            if not residual <= WRONG:
                uncertified += 1
                continue
            R, target = stages.rows
            H, g = R.T @ R, -R.T @ target
            theirs = by_daqp(H, g, stages)
            difference = float(np.max(np.abs(ours - theirs)))
            if difference > WRONG:
                theirs_wrong += violation(H, g, stages, theirs) > violation(H, g, stages, ours)
                difference = float(np.max(np.abs(ours - by_least_squares(R, target, stages))))
                wrong += difference > WRONG
            worst = max(worst, difference)
        quantiles = "".join(
            f"{1e6 * value:{width}.1f}"
            for value, width in zip(np.quantile(times, [0.5, 0.99, 0.999, 1.0]), (13, 8, 8, 8), strict=True)
        )
        lines.append(f"{n:8d}{N:5d}{each:12d}{uncertified:13d}{wrong:7d}{worst:20.1e}{theirs_wrong:12d}{quantiles}")
        print(lines[-1], flush=True)
    folder = Path(__file__).parent / "results"
    folder.mkdir(exist_ok=True)
    (folder / "mpc_programmes.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
