"""Invariance of a diagnosis to the units of torque, angle and time: each is changed alone, on twenty different logs.

    python benchmarks/unit_invariance.py [factor] [words of the logs' names ...]

Each quantity is divided and multiplied by the factor, 1,000 by default. With a power of two numbers keep their digits,
and a difference above 1e-9 is due to a constant with a unit; with 1,000 rounding is added. The angle is changed on
linear axes only: on a rotary one, cos x fixes its unit. Verdict, effects, their probabilities, the gain, and all values
of both fits are compared, relative to themselves or to their standard error. Writes results/unit_invariance.txt.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

import numpy as np  # noqa: E402
from hidden_effects import CASES  # noqa: E402
from machine import Machine, excitation, record  # noqa: E402
from rescaled import Units, differences  # noqa: E402
from rough_logs import rough_log  # noqa: E402

from diagnosis import Diagnosis, diagnose  # noqa: E402
from identification.log import Log  # noqa: E402
from plant.errors import AntidriveError  # noqa: E402

FEW = ("coulomb_friction", "torque_offset")
ROUGH = (0, 1, 2, 3, 5, 6, 7, 9, 11, 12)
HIDDEN = (
    ("rotary", ()),
    ("rotary", ("coulomb_friction", "torque_offset")),
    ("rotary", ("cogging",)),
    ("rotary", ("compliance",)),
    ("rotary", ("payload_change",)),
    ("linear", ("stribeck_friction",)),
    ("linear", ("input_delay", "coulomb_friction")),
    ("linear", ("presliding_hysteresis",)),
    ("linear", ("periodic_disturbance", "quadratic_drag")),
    ("linear", ("end_stop",)),
    ("rotary", ("backlash",)),  # chaotic: rounding decides among the many peaks
)
Made: TypeAlias = tuple[str, Log, tuple[str, ...] | None]


def rough(seed: int) -> Made:
    """A random log of 600 to 1,500 samples, for a diagnosis with few candidates."""
    made = rough_log(seed, longest=1500)
    return str(made), made.log(), FEW


def hidden(place: int, axis: str, names: tuple[str, ...]) -> Made:
    """15 s of a machine with hidden effects at their largest size, for the whole catalogue; linear without gravity."""
    sizes = {case.effect: case.at(case.sizes[-1]) for case in CASES}
    machine = replace(Machine(), gravity=0.0) if axis == "linear" else Machine()
    command = excitation(100 + place, duration=15.0)
    log = record(machine.hiding(**{name: sizes[name] for name in names}), command, seed=place).log()
    return f"{axis}, {' and '.join(names) or 'nothing hidden'}", replace(log, axis=axis), None


def logs() -> Iterator[Callable[[], Made]]:
    for seed in ROUGH:
        yield lambda seed=seed: rough(seed)
    for place, (axis, names) in enumerate(HIDDEN):
        yield lambda place=place, axis=axis, names=names: hidden(place, axis, names)


def units(axis: str, factor: float) -> Iterator[Units]:
    for quantity in ("torque", "angle", "time")[:: 1 if axis == "linear" else 2]:
        for size in (1.0 / factor, factor):
            yield Units(**{quantity: size})


def diagnosed(log: Log, candidates: tuple[str, ...] | None) -> Diagnosis | str:
    try:
        return diagnose(log, candidates=candidates)
    except AntidriveError as error:
        return str(error)


def compared(one: Diagnosis | str, other: Diagnosis | str, among: Units) -> tuple[str, float]:
    """The largest difference, and the quantity that differs."""
    if isinstance(one, str) or isinstance(other, str):
        # The sentence contains numbers of the log.
        same = isinstance(one, str) and isinstance(other, str) and one.split(":")[0] == other.split(":")[0]
        return "sentence" if same else f"{one} or {other}", 0.0 if same else float("inf")
    return max(differences(one, other, among), key=lambda found: found[1])


def main() -> None:
    words = sys.argv[1:]
    factor = float(words.pop(0)) if words and words[0].replace(".", "").isdigit() else 1000.0
    begun, lines, every = time.process_time(), list[str](), list[float]()
    for make in logs():
        name, log, candidates = make()
        if words and not any(word in name for word in words):
            continue
        one = diagnosed(log, candidates)
        verdict = one if isinstance(one, str) else f"{one.verdict} {', '.join(c.effect for c in one.causes)}"
        lines.append(f"{name}: {verdict[:100]}")
        print(lines[-1], flush=True)
        for among in units(log.axis, factor):
            what, size = compared(one, diagnosed(among.log(log), candidates), among)
            every.append(size)
            lines.append(f"  {among}: {size:.1e} ({what})")
            print(lines[-1], flush=True)
    found = np.array(every)
    shares = ", ".join(f"{np.mean(found <= bound):.3f} within {bound:g}" for bound in (1e-9, 1e-6, 1e-3))
    lines.append(f"{found.size} pairs of diagnoses: {shares}; {np.sum(np.isinf(found))} say something else")
    print(lines[-1], f"({time.process_time() - begun:.0f} s of processor time)")
    if not words:
        commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=HERE, capture_output=True, text=True)
        text = "\n".join((f"Factors of {factor:g} on commit {commit.stdout.strip()}", *lines))
        (HERE / "results" / "unit_invariance.txt").write_text(text + "\n")


if __name__ == "__main__":
    main()
