"""Time of one step of the exported C code, without Python, on this machine.

    python benchmarks/mpc_target_step.py

The 1000 steps of `mpc_step.py` are run with the code that `antidrive export` writes; the least time of 40 runs counts
for each. Writes benchmarks/results/mpc_target_step.txt.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from mpc_step import GEARS, PAPER, REFERENCES, SAMPLE_TIME, STEPS, ours

from mpc import export
from plant import sample_step

FLAGS = ("-O2", "-O3 -march=native")
MAIN = """
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "antidrive_controller.h"
enum { STEPS = %(steps)d, WIDTH = ANTIDRIVE_HORIZON + 2, REPEATS = 40 };
static double rows[2 * STEPS][WIDTH], best[2 * STEPS];
static struct antidrive_controller c;
static int order(const void *a, const void *b)
{
  double x = *(const double *)a, y = *(const double *)b;
  return x < y ? -1 : x > y;
}
int main(void)
{
  double torques[2];
  struct timespec from, to;
  FILE *file = fopen("rows.bin", "rb");
  if (!file || fread(rows, sizeof rows, 1, file) != 1) return 1;
  for (int k = 0; k < 2 * STEPS; ++k) best[k] = 1e9;
  for (int j = 0; j < REPEATS; ++j)
    for (int k = 0; k < 2 * STEPS; ++k) {
      if (k %% STEPS == 0) antidrive_init(&c);
      clock_gettime(CLOCK_MONOTONIC, &from);
      antidrive_step_ahead(&c, rows[k][0], rows[k] + 1, torques);
      clock_gettime(CLOCK_MONOTONIC, &to);
      double us = (to.tv_sec - from.tv_sec) * 1e6 + (to.tv_nsec - from.tv_nsec) * 1e-3;
      if (us < best[k]) best[k] = us;
    }
  qsort(best, 2 * STEPS, sizeof *best, order);
  printf("%%10.1f%%10.1f%%10.1f", best[STEPS], best[2 * STEPS * 99 / 100], best[2 * STEPS - 1]);
  return 0;
}
"""


def recorded(horizon: int) -> np.ndarray:
    """(2 STEPS, N + 2) angle and future reference at each step."""
    controller, step, rows = ours(PAPER, horizon), sample_step(PAPER, substeps=4), []
    for reference in REFERENCES:
        controller.reset()
        state, wanted = np.zeros(2), reference(np.arange(STEPS + horizon + 1) * SAMPLE_TIME)
        for k in range(STEPS):
            preview = wanted[k : k + horizon + 1]
            rows.append([state[0], *preview])
            torque = float(GEARS.output_torque(controller.step(state[0], preview).torques))
            inputs = np.array([torque, torque, 0.0, np.inf, 0.0, SAMPLE_TIME, 0.0, 0.0])
            state = np.asarray(step(state, inputs, PAPER.values))[:, 0]
    return np.array(rows)


def main() -> None:
    lines = [
        f"One step of the exported C [us], {os.cpu_count()} cores that others use too (load {os.getloadavg()[1]:.0f})"
    ]
    lines += ["", f"{'gcc':24}{'N':>5}{'median':>10}{'99 %':>10}{'max':>10}"]
    for horizon in (20, 30, 50):
        for flags in FLAGS:
            with tempfile.TemporaryDirectory() as folder:
                for name, text in export(ours(PAPER, horizon)).files.items():
                    (Path(folder) / name).write_text(text)
                (Path(folder) / "main.c").write_text(MAIN % {"steps": STEPS})
                recorded(horizon).tofile(Path(folder) / "rows.bin")
                command = ["gcc", *flags.split(), "-ffp-contract=off", "main.c", "antidrive_controller.c", "-lm"]
                subprocess.run([*command, "-o", "timed"], cwd=folder, check=True)
                printed = subprocess.run(["./timed"], cwd=folder, check=True, capture_output=True, text=True).stdout
            lines.append(f"{flags:24}{horizon:5d}{printed}")
            print(lines[-1], flush=True)
    (Path(__file__).parent / "results" / "mpc_target_step.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
