"""What a log is about stays what it is, however it is cut, ordered, dated or sampled: the verdict too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis import Diagnosis, diagnose
from identification.log import Log, Run

HIDDEN = {"coulomb_friction": {"torque": 0.3}, "cogging": {"amplitude": 0.2, "order": 12.0, "phase": 0.7}}
CANDIDATES = (*HIDDEN, "torque_offset", "gravity_offset", "input_delay")


def run_of(seed: int) -> Run:
    """One at twice the rate, whose torque is held over two samples: every second one tells all of it."""
    command = np.repeat(excitation(seed, duration=6.0), 2)
    made = record(Machine().hiding(**HIDDEN), command, seed=seed, sample_time=0.0025, noise=2e-4)
    return made.run(number=seed)


@cache
def runs() -> tuple[Run, ...]:
    return tuple(run_of(seed) for seed in (1, 2, 3))


@cache
def held_out() -> Log:
    return Log(runs=(run_of(4),), axis="rotary")


def part(run: Run, rows: slice, number: int) -> Run:
    arrays = {name: getattr(run, name)[rows] for name in ("time", "command", "output", "valid", "servo_gain")}
    return replace(run, label=f"{run.label} {number}", number=number, **arrays)


def later(found: tuple[Run, ...]) -> tuple[Run, ...]:
    return tuple(replace(run, time=run.time + 3600.0) for run in found)


def in_another_order(found: tuple[Run, ...]) -> tuple[Run, ...]:
    return found[::-1]


def with_one_in_two(found: tuple[Run, ...]) -> tuple[Run, ...]:
    first, *rest = found
    middle = len(first) // 2
    return (part(first, slice(0, middle), 11), part(first, slice(middle, None), 12), *rest)


def every_second_sample(found: tuple[Run, ...]) -> tuple[Run, ...]:
    return tuple(part(run, slice(None, None, 2), run.number) for run in found)


def barely_disturbed(found: tuple[Run, ...]) -> tuple[Run, ...]:
    draw = np.random.default_rng(0).normal
    size = 1e-7 * max(float(np.ptp(run.output)) for run in found)
    return tuple(replace(run, output=run.output + size * draw(size=len(run))) for run in found)


def diagnosed_of(found: tuple[Run, ...], validation: Log) -> Diagnosis:
    return diagnose(Log(runs=found, axis="rotary"), None, validation, candidates=CANDIDATES)


@cache
def as_it_is() -> Diagnosis:
    return diagnosed_of(runs(), held_out())


@pytest.mark.parametrize("change", [later, in_another_order, with_one_in_two, every_second_sample, barely_disturbed])
def test_the_verdict_is_the_same_however_a_log_is_written(change: Callable[[tuple[Run, ...]], tuple[Run, ...]]) -> None:
    one, other = (
        as_it_is(),
        diagnosed_of(change(runs()), held_out() if change is not every_second_sample else _thinned()),
    )
    assert one.verdict == other.verdict == "named"
    assert {cause.effect for cause in one.causes} == {cause.effect for cause in other.causes} == set(HIDDEN)
    for effect in HIDDEN:
        mine, theirs = (next(c for c in d.causes if c.effect == effect) for d in (one, other))
        assert theirs.probability == pytest.approx(mine.probability, abs=0.02)
        for name, estimate in mine.parameters.items():
            assert estimate.std is not None
            assert theirs.parameters[name].value == pytest.approx(estimate.value, abs=3.0 * estimate.std)


def _thinned() -> Log:
    return Log(runs=every_second_sample(held_out().runs), axis="rotary")
