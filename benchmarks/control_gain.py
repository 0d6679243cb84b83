"""Hide each effect at its largest size, diagnose, and close the loop on the same machine with the extended model.

    python benchmarks/control_gain.py [effect ...]

The controller follows the same reference with the base model, with the extended model and with the true one; the loop
continues where the log ends. It runs twice: with the noise of the log, and with that of a good encoder, where noise is
a smaller part of the error. Prints the table and, if it is complete, writes it to benchmarks/results/control_gain.txt.
"""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

from closed_machine import NOISE, Tracking, swing, track  # noqa: E402
from hidden_effects import CASES, Hidden, logs_of  # noqa: E402

from diagnosis import diagnose  # noqa: E402

END = 60.0  # of the log [s]
SEED = 13
FINE = 2e-5  # noise of a good encoder [rad]
HEADER = (
    f"{'':49}{f'rms [urad], noise {1e6 * NOISE:.0f} urad':>33}{'loss [N^2 m^2]':>20}"
    f"{f'rms [urad], noise {1e6 * FINE:.0f} urad':>33}\n"
    f"{'effect':24}{'named':25}{'base':>9}{'extended':>9}{'true':>9}{'cut':>6}{'base':>10}{'extended':>10}"
    f"{'base':>9}{'extended':>9}{'true':>9}{'cut':>6}"
)


def row(case: Hidden) -> str:
    """The line of the table for one effect."""
    size = case.sizes[2]
    machine = case.machine(size)
    log, held_out = logs_of(machine, seed=SEED, duration=END)
    found = diagnose(log, case.base, held_out)
    models = (found.base.model, found.model.without_clock(END), case.truth(size).without_clock(END))
    coarse, fine = (
        [track(machine, model, swing, 9.0, seed=SEED, begin=END, noise=noise) for model in models]
        for noise in (NOISE, FINE)
    )
    named = ", ".join(cause.effect for cause in found.causes) or found.verdict
    loss = "".join(f"{loop.copper_loss:10.3f}" for loop in coarse[:2])
    return f"{case.effect:24}{named:25}{_errors(coarse)}{loss}{_errors(fine)}"


def _errors(loops: list[Tracking]) -> str:
    base, extended, _ = loops
    errors = "".join(f"{1e6 * loop.rms:9.1f}" for loop in loops)
    cut = round(1.0 - extended.rms / base.rms, 2) + 0.0  # no minus sign before zero
    return f"{errors}{cut:6.2f}"


def main() -> None:
    requested = sys.argv[1:]
    lines = [HEADER]
    print(HEADER)
    for case in CASES:
        if not requested or case.effect in requested:
            lines.append(row(case))
            print(lines[-1], flush=True)
    if not requested:
        folder = HERE / "results"
        folder.mkdir(exist_ok=True)
        (folder / "control_gain.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
