"""Displacement of a servo at rest that is pulled from either side: one servo, and two coupled servos.

    python benchmarks/coupled_servos.py FOLDER

FOLDER holds the public logs of Robonine's backlash bench (Boris Kotov 2025, repository
roboninecom/Backlash-Compensation-in-STS3215-Servo-Actuators): STS3215 servos hold their home position of 2047 counts
while two others pull at them through elastic bands, in turns. Their positions are compared while one or the other
puller is stretched, and after each release. Prints the table and writes it to results/coupled_servos.txt.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd

HOME, REVOLUTION = 2047, 4096
SETTLED = 2  # samples of 0.1 s after a pull has begun or ended
BENCHES = {"one servo": ("single", (5,)), "two, coupled": ("nocomp2", (1, 2))}


def differences(table: pd.DataFrame, held: tuple[int, ...]) -> dict[str, tuple[float, float, int]]:
    """Difference of the held positions under the two pullers [counts], its standard error, and the number of pulls.

    Each pull counts once: "pulled" while it lasts, "let go" until the next begins.
    """
    table = table.dropna()
    signs = np.array([1.0, -1.0])[: len(held)]  # the second of a pair is mounted mirrored
    position = np.mean([sign * (table[f"pos ({m})"] - HOME) for m, sign in zip(held, signs, strict=True)], axis=0)
    at_home = np.all([table[f"target pos ({m})"] == HOME for m in held], axis=0)
    relaxed = {3: table["target pos (3)"].min(), 4: table["target pos (4)"].max()}
    pulling = {m: (table[f"target pos ({m})"] != rest).to_numpy() for m, rest in relaxed.items()}
    any_pull = pulling[3] | pulling[4]
    means: dict[str, dict[int, list[float]]] = {"pulled": {3: [], 4: []}, "let go": {3: [], 4: []}}
    edges = np.flatnonzero(np.diff(np.concatenate(([False], any_pull, [False])).astype(int)))
    begins, ends = edges[::2], edges[1::2]
    for begin, end, following in zip(begins, ends, [*begins[1:], len(table)], strict=True):
        puller = 3 if pulling[3][begin] else 4
        for kind, first, last in (("pulled", begin, end), ("let go", end, following)):
            rows = np.arange(first + SETTLED, last)
            rows = rows[: np.argmin(at_home[rows])] if not at_home[rows].all() else rows
            if rows.size:
                means[kind][puller].append(float(position[rows].mean()))
    found = {}
    for kind, sides in means.items():
        a, b = np.array(sides[3]), np.array(sides[4])
        error = np.sqrt(a.var(ddof=1) / a.size + b.var(ddof=1) / b.size)
        found[kind] = (float(abs(a.mean() - b.mean())), float(error), a.size + b.size)
    return found


def main() -> None:
    folder = Path(sys.argv[1])
    lines = [f"{'':16}{'':10}{'difference [counts]':>22}{'[arcmin]':>12}{'pulls':>8}"]
    for name, (file, held) in BENCHES.items():
        found = differences(pd.read_csv(folder / f"motor_telemetry_{file}.csv"), held)
        for kind, (counts, error, pulls) in found.items():
            arcmin = 360.0 * 60.0 / REVOLUTION
            lines.append(
                f"{name:16}{kind:10}{f'{counts:.2f} +- {error:.2f}':>22}"
                f"{f'{counts * arcmin:.0f} +- {error * arcmin:.0f}':>12}{pulls:8d}"
            )
    text = "\n".join(lines)
    print(text)
    (Path(__file__).parent / "results" / "coupled_servos.txt").write_text(text + "\n")


if __name__ == "__main__":
    main()
