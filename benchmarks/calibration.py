"""Many diagnoses of synthetic logs: correct effects, calibrated probabilities, and no false effects in clean logs?

    python benchmarks/calibration.py sizes
    python benchmarks/calibration.py run PART COUNT SEED [processes]     PART: hidden, several, deleted, clean
    python benchmarks/calibration.py table

`run` adds COUNT diagnoses, on logs of SEED and the following seeds, to benchmarks/results/calibration.jsonl, one per
line. Lines that exist are not run again, so the run may be interrupted and continued. `table` reads that file and
writes calibration.txt. A line depends on its key only.

The size of an effect is given as lambda: twice the log-likelihood by which the model with the true effect beats the
nearest one without it (see tests/hidden_effects.py), each with its best process noise, as an expectation over the
measurement noise. For the same size, lambda differs by a factor of ten and more between excitations. The size is
therefore chosen for each log; `sizes` measures starting values on one log of each effect.
"""

from __future__ import annotations

import json
import multiprocessing
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))

from calibration_table import table  # noqa: E402
from effect_sizes import reaching  # noqa: E402
from hidden_effects import CASES, Hidden, alternative_model, evidence, oracle  # noqa: E402
from machine import (  # noqa: E402
    Follower,
    Machine,
    Record,
    excitation,
    load_fluctuation,
    record,
    wandering_reference,
)
from result_store import Key, add, stored  # noqa: E402

from diagnosis import Diagnosis, diagnose  # noqa: E402
from diagnosis.holdout import restart_window, squared_errors  # noqa: E402
from identification.fit import fit  # noqa: E402
from identification.fit_result import Fit  # noqa: E402
from identification.log import Log  # noqa: E402
from identification.problem import Problem  # noqa: E402
from plant import BadParameter, ServoModel  # noqa: E402
from plant.effects import catalogue  # noqa: E402

STORE = HERE / "results" / "calibration.jsonl"
SIZES = HERE / "results" / "effect_sizes.json"
DURATION, HELD_OUT, NOISE = 30.0, 15.0, 1e-3
LAMBDAS = (30.0, 100.0, 400.0)
_STIFF = 30.0  # of an end stop [N m/rad]
CLEAN = (
    "plain",
    "load 0.01",
    "load 0.05",
    "slow load",
    "coloured",
    "10 bit",
    "1 ms",
    "20 ms",
    "late stamps",
    "closed",
    "closed, load",
    "jitter",
)
CHANNELS = ("time", "command", "output", "valid", "servo_gain")
BY_NAME = {case.effect: case for case in CASES}
# Pairs and triples: effects with distinct signatures, including backlash.
SEVERAL = (
    ("coulomb_friction", "gravity_offset"),
    ("coulomb_friction", "cogging"),
    ("torque_offset", "input_delay"),
    ("quadratic_drag", "cable_stiffness"),
    ("asymmetric_friction", "compliance"),
    ("backlash", "coulomb_friction"),
    ("backlash", "gravity_offset"),
    ("encoder_eccentricity", "presliding_hysteresis"),
    ("periodic_disturbance", "load_dependent_friction"),
    ("coulomb_friction", "gravity_offset", "cogging"),
    ("backlash", "torque_offset", "quadratic_drag"),
    ("input_delay", "stribeck_friction", "payload_change"),
)


def lines(part: str, count: int, first: int) -> Iterator[Key]:
    """Keys of the diagnoses of a part: (part, number of the case, seed)."""
    hide = len(CASES) * len(LAMBDAS)
    cases = {"hidden": hide, "several": len(SEVERAL), "deleted": len(CASES), "clean": len(CLEAN)}[part]
    for place in range(count):
        yield part, place % cases, first + place // cases


def case_on(number: int, seed: int) -> Hidden:
    """An effect to hide under the commands of a seed; an end stop's size is the fraction of the travel it blocks."""
    case = CASES[number]
    if case.effect != "end_stop":
        return case
    (run,) = record(Machine(), excitation(2 * seed, duration=DURATION), seed=seed, noise=0.0).log().runs
    low, high = float(run.output.min()), float(run.output.max())
    return replace(case, at=lambda s: {"angle": high - s * (high - low), "stiffness": _STIFF})


def sizes_of(number: int) -> list[tuple[float, float]]:
    """(size, lambda) of one effect, with increasing size, on the log of one seed."""
    seed = 4000
    case = case_on(number, seed)
    commands = excitation(2 * seed, duration=DURATION)
    known: list[tuple[float, float]] = []
    for size in np.geomspace(case.sizes[0] / 100.0, case.sizes[-1], 21):
        try:
            log = record(case.machine(float(size)), commands, seed=seed, noise=NOISE).log()
            known.append((float(size), evidence(case, float(size), log)))
        except BadParameter:
            continue
        if known[-1][1] > 2.0 * LAMBDAS[-1]:
            break
    return known


def size_for(case: Hidden, wanted: float) -> float:
    """The size at which lambda first reaches a value, by interpolation of the measured sizes in logarithms."""
    known = json.loads(SIZES.read_text())[case.effect]
    for (a, below), (b, above) in pairwise(known):
        if above >= wanted:
            low, high = np.log(max(below, 1.0)), np.log(above)
            share = np.clip((np.log(wanted) - low) / max(high - low, 1e-9), 0.0, 1.0)
            return float(a * (b / a) ** share)
    return float(known[-1][0])


def lambda_of(case: Hidden, size: float, seed: int) -> float:
    """Expected lambda of a size under the commands of a seed.

    The mean over a noise sequence and its negative, which cancels their first-order influence, less the bias of the
    additional parameters.
    """
    commands, machine = excitation(2 * seed, duration=DURATION), case.machine(size)
    logs = [record(machine, commands, seed=seed, noise=noise).log() for noise in (NOISE, -NOISE)]
    more = len(case.truth(size).names) - len(alternative_model(case, size).names)
    return float(np.mean([evidence(case, size, log) for log in logs])) - more


@lru_cache(maxsize=1)
def sizes_on(number: int, seed: int) -> dict[float, tuple[float, float]]:
    """The sizes of an effect that come closest to each lambda under the commands of a seed, with their lambdas."""
    case = case_on(number, seed)
    begin = {wanted: size_for(case, wanted) for wanted in (100.0, 30.0, 400.0)}
    return reaching(begin, lambda size: lambda_of(case, size, seed), (case.sizes[0] / 1000.0, case.sizes[-1]))


def hidden(number: int, seed: int) -> dict[str, Any]:
    """One hidden effect at a given lambda."""
    case, wanted = case_on(number // len(LAMBDAS), seed), LAMBDAS[number % len(LAMBDAS)]
    commands = excitation(2 * seed, duration=DURATION)
    size, reached = sizes_on(number // len(LAMBDAS), seed)[wanted]
    log = record(case.machine(size), commands, seed=seed, noise=NOISE).log()
    held = record(case.machine(size), excitation(2 * seed + 1, duration=HELD_OUT), seed=seed + 1, noise=NOISE).log()
    begin = time.perf_counter()
    found = diagnose(log, case.base, held)
    reported = answer(found, time.perf_counter() - begin)
    best = oracle(case, size, log)
    errors = held_out_errors([found.base, found.extended, best], held, window_of(best))
    return {
        "truth": [case.effect],
        "wanted": wanted,
        "lambda": reached,
        "size": size,
        **reported,
        **evidence_of_sets(found, case.effect),
        "oracle": best.log_likelihood - found.base.log_likelihood,
        "errors": errors,
    }


def several(number: int, seed: int) -> dict[str, Any]:
    """Two or three effects at once, each at the largest of its sizes (backlash: at the middle one)."""
    names = SEVERAL[number]
    machine = Machine()
    for name in names:
        case = BY_NAME[name]
        machine = machine.hiding(**{name: case.at(case.sizes[1 if name == "backlash" else 2])})
    log = record(machine, excitation(2 * seed, duration=DURATION), seed=seed, noise=NOISE).log()
    held = record(machine, excitation(2 * seed + 1, duration=HELD_OUT), seed=seed + 1, noise=NOISE).log()
    begin = time.perf_counter()
    found = diagnose(log, None, held)
    reported = answer(found, time.perf_counter() - begin)
    return {"truth": list(names), "shown": shown(names, log), **reported}


def shown(names: tuple[str, ...], log: Log) -> dict[str, float]:
    """lambda of each of several true effects given the others: a load at rest does not show load-dependent effects."""
    truth = ServoModel.paper()
    for name in names:
        case = BY_NAME[name]
        truth = truth.with_effect(catalogue[name](**case.at(case.sizes[1 if name == "backlash" else 2])))
    oracle = fit(log, truth, fixed=[name for name in truth.names if name != "inertia"])
    best = Problem.of(log, truth).descend(oracle)
    without = {name: Problem.of(log, best.model.without_effect(name)).descend(best) for name in names}
    return {name: 2.0 * (best.log_likelihood - less.log_likelihood) for name, less in without.items()}


def deleted(number: int, seed: int) -> dict[str, Any]:
    """One effect at the largest of its sizes, removed from the catalogue."""
    case = CASES[number]
    machine = case.machine(case.sizes[-1])
    log = record(machine, excitation(2 * seed, duration=DURATION), seed=seed, noise=NOISE).log()
    held = record(machine, excitation(2 * seed + 1, duration=HELD_OUT), seed=seed + 1, noise=NOISE).log()
    begin = time.perf_counter()
    found = diagnose(log, case.base, held, exclude=[case.effect])
    best = oracle(case, case.sizes[-1], log)
    errors = held_out_errors([found.base, found.extended, best], held, window_of(best))
    return {"truth": [case.effect], **answer(found, time.perf_counter() - begin), "errors": errors}


def clean(number: int, seed: int) -> dict[str, Any]:
    """No hidden effect, but another imperfection of the log."""
    kind = CLEAN[number]
    begin = time.perf_counter()
    found = diagnose(clean_log(kind, seed), None)
    return {"truth": [], "kind": kind, **answer(found, time.perf_counter() - begin)}


def clean_log(kind: str, seed: int) -> Log:
    """The paper's machine, recorded with a given imperfection."""
    options: dict[str, Any] = {"sample_time": 0.005, "noise": NOISE}
    if kind in ("1 ms", "20 ms"):
        options["sample_time"] = float(kind.split()[0]) * 1e-3
    if kind == "10 bit":
        options["bits"] = 10
    if kind == "coloured":
        options["noise"] = 0.0
    if kind == "jitter":
        return unevenly_sampled(seed)
    dt = options["sample_time"]
    played: Any = excitation(2 * seed, duration=DURATION, sample_time=dt)
    if kind.startswith("closed"):
        played = Follower(reference=wandering_reference(2 * seed, duration=DURATION))
    if kind.endswith(("load", "load 0.01", "load 0.05")):
        rms = 0.05 if kind == "load 0.05" else 0.01
        slow = 5.0 if kind == "slow load" else 0.02
        shape = (round(DURATION / dt), 1)
        options["load_torque"] = load_fluctuation(seed, rms, shape, correlation_time=slow)
    out: Record = record(Machine(), played, seed=seed, **options)
    log = out.log()
    (run,) = log.runs
    rng = np.random.default_rng([seed, 9])
    if kind == "coloured":
        noise = NOISE * np.sqrt(1.0 - 0.9**2) * lfilter([1.0], [1.0, -0.9], rng.standard_normal(len(run)))
        run = replace(run, output=run.output + noise)
    if kind == "late stamps":
        # The recorded time stamps are randomly late by up to a tenth of a sample.
        run = replace(run, time=run.time + 0.1 * dt * rng.uniform(size=len(run)))
    return Log(runs=(run,), axis="rotary")


def unevenly_sampled(seed: int) -> Log:
    """Samples 4.5 to 5.5 ms apart at random, of command and angle alike, with correct time stamps."""
    fine = 5e-4
    rng = np.random.default_rng([seed, 10])
    places = np.cumsum(rng.integers(9, 12, round(DURATION / 5e-3)))
    places = places[places < round(DURATION / fine)]
    even = excitation(2 * seed, duration=DURATION)[: places.size]
    played = np.zeros(round(DURATION / fine))
    for value, first, last in zip(even, places, [*places[1:], played.size], strict=True):
        played[first:last] = value
    (run,) = record(Machine(), played, seed=seed, sample_time=fine, noise=NOISE).log().runs
    seen = replace(run, **{name: getattr(run, name)[places] for name in CHANNELS})
    return Log(runs=(seen,), axis="rotary")


def answer(found: Diagnosis, seconds: float) -> dict[str, Any]:
    """The result of a diagnosis, as plain values."""
    return {
        "verdict": found.verdict,
        "causes": [
            {"effect": c.effect, "probability": c.probability, "rivals": dict(c.alternatives)} for c in found.causes
        ],
        "sets": [[list(each.effects), each.probability, each.log_marginal] for each in found.sets],
        "depends_on": list(found.unexplained.depends_on),
        "unexplained": found.unexplained.share,
        "bandwidth": [found.base.bandwidth, found.extended.bandwidth],
        "seconds": seconds,
    }


def evidence_of_sets(found: Diagnosis, effect: str) -> dict[str, float | None]:
    """Gain in log-likelihood of the best set with an effect, and of the best set without it."""
    rise = {True: list[float](), False: [0.0]}
    for each in found.sets:
        if each.fit is not None:
            rise[effect in each.effects].append(each.fit.log_likelihood - found.base.log_likelihood)
    return {"own": max(rise[True], default=None), "rival": max(rise[False])}


def window_of(truth: Fit) -> float | None:
    """Restart interval of the simulation if the true model is chaotic, as a whole run would then diverge; else None."""
    return restart_window(truth.log) if truth.model.chaotic else None


def held_out_errors(fits: list[Fit], log: Log, window: float | None) -> list[float]:
    """RMS errors of free simulations of the validation run [rad], restarted after each window [s]."""
    return [float(np.sqrt(np.mean(squared_errors(log, found.model, window, found.bandwidth)[0]))) for found in fits]


def one(key: Key) -> dict[str, Any]:
    part, number, seed = key
    reported = {"hidden": hidden, "several": several, "deleted": deleted, "clean": clean}[part](number, seed)
    return {"key": list(key), **reported}


def main() -> None:
    if sys.argv[1] == "sizes":
        with multiprocessing.get_context("spawn").Pool(2) as pool:
            known = dict(zip(BY_NAME, pool.imap(sizes_of, range(len(CASES))), strict=True))
        SIZES.write_text(json.dumps(known, indent=1) + "\n")
        return
    if sys.argv[1] == "run":
        part, count, first = sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
        chunk = len(LAMBDAS) if part == "hidden" else 1  # of cases that share the search for sizes
        add(STORE, lines(part, count, first), one, int(sys.argv[5]) if len(sys.argv) > 5 else 2, chunk)
    text = table(stored(STORE))
    (HERE / "results" / "calibration.txt").write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
