"""Random quadratic programs of the controller against an independent solver, from unfavourable starts, with times.

    python benchmarks/mpc_quadratic_programs.py [count]

Half of them have random dynamics, half are a servo far from its reference, whose active set may cycle. Each starts from
a random guess of the active bounds. The last three kinds are such a servo with a torque rate and soft limits of angle
and speed, often violated at the start. Needs DAQP (`pip install 'antidrive[bench]'`) and a C compiler. DAQP's answers
are checked too: if one is not optimal, a third solver decides. With limits the costs are compared, because DAQP's
slacks make the torques inexact. Writes benchmarks/results/mpc_quadratic_programs.txt.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import daqp
import numpy as np
from scipy.optimize import lsq_linear

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from random_quadratic_programs import Array, Fences, Solver, Stages, fenced_stages, random_stages, servo_stages

WRONG = 1e-6  # fraction of the range of the torques
SHAPES = ((2, 20), (2, 50), (3, 30), (4, 30))  # states, samples
FENCED = (20, 30, 50)  # samples
SHARE = 0.1  # fraction of the programs, with limits


def violation(H: Array, g: Array, stages: Stages, e: Array) -> float:
    """Violation of the optimality conditions, in the unit of e."""
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


def excess(stages: Stages, fences: Fences, e: Array) -> Array:
    """(N, 3) by how much each quantity is outside its interval."""
    q = fences.rows(stages) @ e
    return np.maximum(np.maximum(fences.ends[..., 0] - q, q - fences.ends[..., 1]), 0.0)


def cost(H: Array, g: Array, stages: Stages, fences: Fences, e: Array) -> float:
    """Cost, including the penalty of the remaining violation of the limits."""
    return float(0.5 * e @ H @ e + g @ e + np.sum(excess(stages, fences, e)[:, 1:] * fences.prices[1:]))


def by_daqp_with_slacks(H: Array, g: Array, stages: Stages, fences: Fences) -> Array:
    """Each soft interval has a slack variable, in units of torque."""
    N, rows = g.size, fences.rows(stages)
    units = np.tile(fences.moved[1:], N)
    soft, ends = rows[:, 1:].reshape(-1, N) / units[:, None], fences.ends[:, 1:].reshape(-1, 2) / units[:, None]
    top = float(np.max(np.diag(H)))
    wide = np.zeros((3 * N, 3 * N))
    wide[:N, :N], wide[N:, N:] = H / top, 1e-12 * np.eye(2 * N)
    far, slack, none = np.full(2 * N, 1e30), np.eye(2 * N), np.zeros((N, 2 * N))
    A = np.block([[rows[:, 0], none], [soft, -slack], [soft, slack]])
    lower = np.concatenate((stages.low, np.zeros(2 * N), fences.ends[:, 0, 0], -far, ends[:, 0]))
    upper = np.concatenate((stages.high, far, fences.ends[:, 0, 1], ends[:, 1], far))
    linear = np.append(g, np.tile(fences.prices[1:], N) * units) / top
    limits = np.clip(upper, -1e30, 1e30), np.clip(lower, -1e30, 1e30)
    return np.array(daqp.solve(wide, linear, A, *limits)[0])[:N]


def fenced(N: int, count: int) -> str:
    """Result of programs with limits, in a line."""
    solver, rng = Solver(2, N, fenced=True), np.random.default_rng(N)
    times, worst, wrong, uncertified, theirs_wrong, active = np.empty(count), 0.0, 0, 0, 0, 0
    for k in range(count):
        stages, fences = fenced_stages(rng, N, rng.uniform(-1, 2))
        guess, pressed = rng.integers(-1, 2, N), rng.integers(-2, 3, (N, 4)) * (rng.random((N, 4)) < 0.1)
        for repeat in range(5):
            solver.load(stages, guess, fences, pressed)
            begin = time.perf_counter()
            residual = solver.machine_code()
            took = time.perf_counter() - begin
            times[k] = took if repeat == 0 else min(times[k], took)
        ours = solver.arrays["e"].copy()
        if not residual <= WRONG:
            uncertified += 1
            continue
        active += bool(np.any(solver.program.forces))
        R, target = stages.rows
        H, g = R.T @ R, -R.T @ target
        theirs = by_daqp_with_slacks(H, g, stages, fences)
        best, found = (cost(H, g, stages, fences, e) for e in (theirs, ours))
        scale = abs(best) + float(np.max(np.diag(H)))
        broken = float(np.max(excess(stages, fences, ours)[:, 0]))  # the rate is a hard limit
        theirs_wrong += best > found + WRONG * scale
        wrong += found > best + WRONG * scale or broken > WRONG
        worst = max(worst, broken, (found - best) / scale)
    return row(2, N, count, uncertified, wrong, worst, theirs_wrong, times) + f"{active:9d} with active limits"


def row(n: int, N: int, count: int, uncertified: int, wrong: int, worst: float, theirs_wrong: int, times: Array) -> str:
    quantiles = "".join(
        f"{1e6 * value:{width}.1f}"
        for value, width in zip(np.quantile(times, [0.5, 0.99, 0.999, 1.0]), (13, 8, 8, 8), strict=True)
    )
    return f"{n:8d}{N:5d}{count:12d}{uncertified:13d}{wrong:7d}{worst:20.1e}{theirs_wrong:12d}{quantiles}"


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    lines = [f"{count} programs against DAQP", ""]
    lines.append(
        f"{'states':>8}{'N':>5}{'programs':>12}{'uncertified':>13}{'wrong':>7}{'largest difference':>20}"
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
            for repeat in range(5):  # the least of several times: the machine may be busy
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
        lines.append(row(n, N, each, uncertified, wrong, worst, theirs_wrong, times))
        print(lines[-1], flush=True)
    lines += ["", "With a torque rate and soft limits; the difference is that of the costs", ""]
    for N in FENCED:
        lines.append(fenced(N, round(SHARE * count)))
        print(lines[-1], flush=True)
    folder = Path(__file__).parent / "results"
    folder.mkdir(exist_ok=True)
    (folder / "mpc_quadratic_programs.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
