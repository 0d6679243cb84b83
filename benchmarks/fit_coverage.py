"""Coverage of the fit's 95 % intervals on randomly drawn machines, one minute each.

    python benchmarks/fit_coverage.py [logs]

Prints the table and writes it to benchmarks/results/fit_coverage.txt.
"""

from __future__ import annotations

import multiprocessing
import sys
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

from machine import Array, Machine, excitation, record  # noqa: E402

from identification.fit import fit  # noqa: E402
from identification.log import Log  # noqa: E402

NAMES = ("inertia", "gravity", "viscous_friction", "dead_zone.half_width")


def drawn(count: int, seed: int = 0) -> Array:
    """(count, 4) true J, alpha, K, gamma, each within a factor of 1.6 of the paper's."""
    rng = np.random.default_rng([seed, 5])
    return np.array([2.0, 0.5, 0.8, 0.5]) * 1.6 ** rng.uniform(-1.0, 1.0, (count, 4))


def recorded(truth: Array, duration: float = 60.0, seed: int = 0) -> list[Log]:
    """A log of each machine, with a separate input."""
    inertia, gravity, friction, gap = truth.T
    machines = Machine(
        inertia=inertia, gravity=gravity, viscous_friction=friction, effects={"dead_zone": {"half_width": gap}}
    )
    commands = np.column_stack([excitation(1000 * seed + s, duration=duration) for s in range(len(truth))])
    return record(machines, commands, seed=seed).logs()


def estimated(log: Log) -> tuple[list[float], list[float], float, float]:
    """Values, standard errors (nan if the fit gives none), bandwidth and seconds."""
    begin = time.perf_counter()
    found = fit(log)
    seconds = time.perf_counter() - begin
    lines = [found[name] for name in NAMES]
    values = [np.nan if p.value is None else p.value for p in lines]
    errors = [np.nan if p.std is None else p.std for p in lines]
    return values, errors, found.bandwidth, seconds


def table(truth: Array, values: Array, errors: Array) -> str:
    lines = [f"{'parameter':22}{'covered':>9}{'median error':>15}{'worst error':>14}{'std of (est-true)/std':>24}"]
    for name, true, value, error in zip(NAMES, truth.T, values.T, errors.T, strict=True):
        inside = np.mean(np.abs(value - true) < 1.96 * error)
        relative = np.abs(value / true - 1.0)
        spread = np.std((value - true) / error)
        lines.append(f"{name:22}{inside:9.1%}{np.median(relative):15.2e}{relative.max():14.2e}{spread:24.2f}")
    return "\n".join(lines)


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 600
    truth = drawn(count)
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        results = pool.map(estimated, recorded(truth), chunksize=1)
    values, errors = (np.array([result[i] for result in results]) for i in (0, 1))
    bandwidths, seconds = (np.array([result[i] for result in results]) for i in (2, 3))
    text = "\n".join(
        (
            f"{count} machines, 60 s at 5 ms, noise 1e-3 rad, 17-bit encoder; 95 % intervals",
            table(truth, values, errors),
            f"output error chosen in {np.mean(bandwidths == 0.0):.1%} of the fits; "
            f"{np.median(seconds):.2f} s a fit (median), {seconds.max():.2f} s (longest)",
        )
    )
    print(text)
    folder = HERE / "results"
    folder.mkdir(exist_ok=True)
    (folder / "fit_coverage.txt").write_text(text + "\n")


if __name__ == "__main__":
    main()
