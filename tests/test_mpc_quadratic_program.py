"""The quadratic program of a step: same solution as other solvers, from any start, and always certified."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from random_quadratic_programs import Solver, Stages, random_stages, servo_stages
from scipy.optimize import lsq_linear

import mpc.quadratic_program
from mpc.interior_point import solve_from_inside
from plant import machine_code

Array = NDArray[np.float64]
FORMS = [False] if machine_code.compiler() is None else [False, True]  # compiled
ROUNDS = 25

solver = cache(Solver)
seeds = st.integers(0, 2**32 - 1)


def by_others(stages: Stages) -> Array:
    R, target = stages.rows
    free = stages.high > stages.low  # the solver does not accept an interval of length zero
    e = np.where(free, 0.0, stages.low)
    target = target - R @ e
    answer = lsq_linear(
        R[:, free], target, (stages.low[free], stages.high[free]), method="bvls", tol=1e-15, max_iter=2000
    )
    assert answer.success
    e[free] = answer.x
    return e


@pytest.mark.parametrize("compiled", FORMS)
@settings(max_examples=60, deadline=None)
@given(st.integers(2, 4), st.sampled_from([2, 7, 30]), seeds, st.floats(0, 5))
def test_it_agrees_with_another_solver(compiled: bool, n: int, N: int, seed: int, hardness: float) -> None:
    rng = np.random.default_rng(seed)
    stages = random_stages(rng, n, N, hardness)
    ours, residual = solver(n, N).solve(stages, rng.integers(-1, 2, N), compiled)
    assert residual <= 1e-6
    assert np.all((ours >= stages.low - 1e-12) & (ours <= stages.high + 1e-12))
    assert ours == pytest.approx(by_others(stages), abs=1e-6)


@settings(max_examples=40, deadline=None)
@given(st.integers(2, 4), seeds, st.floats(0, 5))
def test_both_forms_agree(n: int, seed: int, hardness: float) -> None:
    rng = np.random.default_rng(seed)
    stages = random_stages(rng, n, 30, hardness)
    guess = rng.integers(-1, 2, 30)
    answers = [solver(n, 30).solve(stages, guess, compiled)[0] for compiled in FORMS]
    assert answers[0] == pytest.approx(answers[-1], abs=1e-12)


@pytest.mark.parametrize("compiled", FORMS)
def test_the_second_method_takes_over(compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    both, cycling = solver(2, 50), []
    for seed in range(100):
        stages = servo_stages(np.random.default_rng(seed), 50, 0.5)
        with monkeypatch.context() as alone:
            alone.setattr(mpc.quadratic_program, "solve_from_inside", lambda program: None)
            if both.solve(stages)[1] > 1e-6:
                cycling.append(stages)
    assert cycling
    for stages in cycling:
        answer, residual = both.solve(stages, compiled=compiled)
        assert residual <= 1e-6
        assert answer == pytest.approx(by_others(stages), abs=1e-6)


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_the_guess_from_inside_is_nearly_right(seed: int) -> None:
    stages = random_stages(np.random.default_rng(seed), 2, 30, 2.0)
    both = solver(2, 30)
    both.solve(stages)
    solution = both.program.bounds[:, 0].copy()
    solve_from_inside(both.program)
    assert np.sum(both.program.bounds[:, 0] != solution) <= 1


@pytest.mark.parametrize("compiled", FORMS)
def test_a_solution_that_is_not_one_is_not_certified(compiled: bool) -> None:
    both, stages = solver(2, 30), random_stages(np.random.default_rng(3), 2, 30, 2.0)
    try:
        both.limit(0)
        both.arrays["e"][:], both.arrays["s"][:] = 0.0, 0.0
        assert both.solve(stages, compiled=compiled)[1] == np.inf
    finally:
        both.limit(ROUNDS)
    assert both.solve(stages, compiled=compiled)[1] <= 1e-6


@pytest.mark.parametrize("compiled", FORMS)
@pytest.mark.parametrize("place", ["miss", "low", "A", "end"])
def test_a_program_that_is_not_a_number_has_no_solution(compiled: bool, place: str) -> None:
    stages = random_stages(np.random.default_rng(3), 2, 7, 1.0)
    getattr(stages, place)[1] = np.nan
    with np.errstate(all="ignore"):
        assert solver(2, 7).solve(stages, compiled=compiled)[1] == np.inf


@pytest.mark.parametrize("compiled", FORMS)
def test_bounds_that_cross_leave_no_solution(compiled: bool) -> None:
    stages = random_stages(np.random.default_rng(3), 2, 7, 1.0)
    stages.low[2] = stages.high[2] + 0.1
    assert solver(2, 7).solve(stages, compiled=compiled)[1] == np.inf


def test_the_residual_distinguishes_optimal_from_not() -> None:
    both, stages = solver(2, 7), random_stages(np.random.default_rng(5), 2, 7, 1.0)
    e, residual = both.solve(stages)
    assert residual < 1e-12
    R, target = stages.rows
    moved = 0.9 * e
    both.program.bounds[:, 0] = -1.0
    both.program.bounds[:, 1] = both.program.bounds[:, 2] = moved
    both.program.sweep()  # all torques held at these values
    both.program.bounds[:, 1], both.program.bounds[:, 2] = stages.low, stages.high
    slope = R.T @ (R @ moved - target)
    curvature = both.program.law[:, -1]
    expected = np.max(np.abs(moved - np.clip(moved - slope / curvature, stages.low, stages.high)))
    assert both.program.residual() == pytest.approx(expected, rel=1e-9)
    assert expected > 1e-3
    both.program.e[0] = np.nan
    assert not both.program.residual() <= 1e-6
