"""Axes with friction: the improvement by friction in the model, compared with other controllers.

    python benchmarks/friction_axes.py [number of axes]

Every loop is closed on the rig. The axes are randomly drawn from the grid of inertia, sample time, kind and size of the
friction and encoder; the whole grid takes hours. `ratio` is the error with the friction in the model over that of the
same controller without it; the friction in the model is exact, 30 % too low and too high. If the ratio is above 1.05
and the error is larger by more than a twentieth of a count, eight seeds are run and the ratio of the means counts. The
other controllers (a cascade of P and PI, PD with a disturbance observer) use the same friction; for each task the best
of four tunings counts. Writes benchmarks/results/friction_axes.txt.
"""

from __future__ import annotations

import itertools
import sys
import time
import warnings
from pathlib import Path

import numpy as np
from friction_machines import BITS, GEARS, INERTIAS, KINDS, SAMPLE_TIMES, SHARES, TASKS, Axis, Score, score
from friction_peers import Peer, candidates

from mpc import Controller

FACTORS = (1.0, 0.7, 1.3)
FIRST, SEEDS = 100, 8
DRAWN = 48  # axes by default; the other controllers are run on a quarter of them
PEERS = ("cascade", "observed")


def axes(count: int) -> list[Axis]:
    """Some axes of the grid, drawn with a fixed seed; all of them if there are no more."""
    grid = itertools.product(INERTIAS, SAMPLE_TIMES, KINDS, SHARES, BITS)
    every = [Axis(inertia=J, sample_time=T, kind=kind, share=s, bits=b) for J, T, kind, s, b in grid]
    drawn = np.random.default_rng(38).permutation(len(every))[:count]
    return [every[place] for place in drawn]


def ours(axis: Axis, factor: float | None, task: str, seed: int = FIRST) -> Score:
    """Our controller with its default tuning."""
    return score(axis, Controller(axis.model(factor), GEARS, **axis.options), TASKS[task], seed)


def ratio(axis: Axis, factor: float, task: str, without: Score) -> tuple[float, float, Score]:
    """Ratio of the errors, difference of the errors in counts, and the first loop.

    If one seed shows a deterioration by friction in the model, the errors are means over eight seeds.
    """
    first = ours(axis, factor, task)
    known, unknown = first.rms, without.rms
    if known > 1.05 * unknown and known - unknown > 0.05 * 2 * np.pi / 2**axis.bits:
        seeds = range(FIRST, FIRST + SEEDS)
        known, unknown = (np.mean([ours(axis, f, task, seed).rms for seed in seeds]) for f in (factor, None))
    return known / unknown, (known - unknown) * 2**axis.bits / (2 * np.pi), first


def best_peer(axis: Axis, factor: float, kind: str, task: str) -> Score | None:
    """The loop with the least error of a peer that keeps contact."""
    model = axis.model(factor)
    found = [
        score(axis, Peer(axis, model, feedback), TASKS[task], FIRST)
        for feedback in candidates(axis, model.inertia, kind)
    ]
    return min((each for each in found if each.flank > 0), key=lambda each: each.rms, default=None)


class Table:
    """Lines that are printed and saved immediately, so that an interrupted run leaves its results."""

    def __init__(self) -> None:
        self._path = Path(__file__).parent / "results" / "friction_axes.txt"
        self._path.write_text("")

    def say(self, line: str = "") -> None:
        """Add a line."""
        print(line, flush=True)
        with self._path.open("a") as file:
            file.write(line + "\n")


def mean(values: list[float]) -> float:
    """Geometric mean."""
    return float(np.exp(np.mean(np.log(values)))) if values else float("nan")


def knowledge(table: Table, chosen: list[Axis]) -> dict[tuple[Axis, str, float], Score]:
    """Ratios over axes; returns the loops by axis, task and factor."""
    table.say("Error without friction in the model [mrad], then ratios for 1, 0.7, 1.3 of it")
    ratios: dict[tuple[str, float], list[float]] = {}
    harm: dict[str, list[str]] = {}
    loops, lost = {}, 0
    for axis in chosen:
        line = str(axis)
        for task in TASKS:
            without = ours(axis, None, task)
            line += f" | {task} {1e3 * without.rms:7.3f}"
            for factor in FACTORS:
                value, counts, first = ratio(axis, factor, task, without)
                ratios.setdefault((task, factor), []).append(value)
                line += f" {value:5.2f}{'!' if first.flank <= 0 else ''}"
                lost += first.flank <= 0
                if value > 1.05:
                    harm.setdefault(task, []).append(f"{axis} x{factor:g}: {value:.2f}, {counts:.2f} counts more")
                loops[axis, task, factor] = first
        table.say(line)
    for task in TASKS:
        text = "   ".join(
            f"x{factor:g} {mean(ratios[task, factor]):.2f} ({max(ratios[task, factor]):.2f})" for factor in FACTORS
        )
        table.say(f"  {task:6} geometric mean (worst): {text}")
    table.say(f"  loops in which contact was lost: {lost} of {len(chosen) * len(TASKS) * len(FACTORS)}")
    for task, cells in harm.items():
        table.say(f"  {task}: above 1.05 in {len(cells)}:")
        for cell in cells:
            table.say(f"    {cell}")
    table.say()
    return loops


def others(table: Table, chosen: list[Axis], factor: float, loops: dict[tuple[Axis, str, float], Score]) -> None:
    """Our error over that of each peer, with the same friction in the model."""
    heading = f"{len(chosen)} axes, {factor:g} of the friction in the model"
    table.say(f"Against others: {heading}; error of the best tuning [mrad] and ours over it")
    ratios: dict[tuple[str, str], list[float]] = {}
    chatter: dict[str, list[float]] = {}
    for axis in chosen:
        line = str(axis)
        for task in TASKS:
            own = loops[axis, task, factor]
            line += f" | {task} {1e3 * own.rms:7.3f}"
            for kind in PEERS:
                peer = best_peer(axis, factor, kind, task)
                if peer is None:
                    line += "  contact lost "
                    continue
                ratios.setdefault((task, kind), []).append(own.rms / peer.rms)
                if task == "sine":
                    chatter.setdefault(kind, []).append(own.chatter / peer.chatter)
                line += f"  {1e3 * peer.rms:7.3f} {own.rms / peer.rms:6.2f}"
        table.say(line)
    for task, kind in ratios:
        found = ratios[task, kind]
        table.say(f"  {task:6} over {kind:9} {mean(found):5.2f} ({max(found):.2f}), {len(found)} axes with contact")
    for kind, found in chatter.items():
        table.say(f"  change of the torque from sample to sample in the sine, ours over {kind}: {mean(found):.2f}")
    table.say()


def main() -> None:
    """48 axes take a quarter of an hour on one core."""
    warnings.simplefilter("ignore")  # python-control on poles near the unit circle
    table, begin = Table(), time.perf_counter()
    chosen = axes(int(sys.argv[1]) if sys.argv[1:] else DRAWN)
    whole = len(INERTIAS) * len(SAMPLE_TIMES) * len(KINDS) * len(SHARES) * len(BITS)
    table.say(f"Friction axes: {len(chosen)} of {whole}, drawn at random; all tuned by default; J [kg m^2], Ts [ms]")
    table.say()
    loops = knowledge(table, chosen)
    for factor in FACTORS:
        others(table, chosen[: -(-len(chosen) // 4)], factor, loops)
    table.say(f"{(time.perf_counter() - begin) / 60:.0f} minutes")


if __name__ == "__main__":
    main()
