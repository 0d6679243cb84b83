"""Hard and soft intervals in the program of a step: torque rates, and limits of angle and speed."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from random_quadratic_programs import Fences, Solver, Stages, fenced_stages

import mpc.quadratic_program
from mpc import Controller, closed_loop
from mpc.real_time_iteration import within_rate
from plant import GearTrain, Rig, ServoModel, machine_code

Array = NDArray[np.float64]
FORMS = [False] if machine_code.compiler() is None else [False, True]  # compiled

solver = cache(Solver)
seeds = st.integers(0, 2**32 - 1)


def excess(stages: Stages, fences: Fences, e: Array) -> Array:
    """(N, 3) violation of the interval of each constrained quantity."""
    q = fences.rows(stages) @ e
    return np.maximum(np.maximum(fences.ends[..., 0] - q, q - fences.ends[..., 1]), 0.0)


def cost(stages: Stages, fences: Fences, e: Array) -> float:
    R, target = stages.rows
    return float(0.5 * np.sum((R @ e - target) ** 2) + np.sum(excess(stages, fences, e)[:, 1:] * fences.prices[1:]))


def by_others(stages: Stages, fences: Fences, *, hard: bool) -> tuple[Array, Array] | None:
    """Torques, and multipliers (N, 3), by qpOASES, with a slack for each soft limit; None if there is no solution."""
    N = stages.miss.size
    R, target = stages.rows
    rows, soft = fences.rows(stages), 0 if hard else 2 * N
    unit = np.tile(fences.moved[1:], N)  # slacks in units of torque
    H, g = np.zeros((N + soft, N + soft)), np.zeros(N + soft)
    H[:N, :N], g[:N] = R.T @ R, -R.T @ target
    lower, upper = np.append(stages.low, np.zeros(soft)), np.append(stages.high, np.full(soft, np.inf))
    A = np.zeros((3 * N + soft, N + soft))
    A[:N, :N], A[N : 3 * N, :N] = rows[:, 0], rows[:, 1:].reshape(-1, N) / unit[:, None]
    ends = np.concatenate((fences.ends[:, 0], fences.ends[:, 1:].reshape(-1, 2) / unit[:, None]))
    if soft:
        g[N:] = np.tile(fences.prices[1:], N) * unit
        A[3 * N :] = A[N : 3 * N]
        A[N : 3 * N, N:], A[3 * N :, N:] = -np.eye(soft), np.eye(soft)
        free = np.full(soft, np.inf)
        ends = np.vstack((ends, np.column_stack((ends[N:, 0], free))))
        ends[N : 3 * N, 0] = -np.inf
    scale = 1.0 / np.max(np.diag(H))
    shapes = {"h": ca.DM(H).sparsity(), "a": ca.DM(A).sparsity()}
    other = ca.conic("other", "qpoases", shapes, {"printLevel": "none", "error_on_fail": False})
    answer = other(h=scale * H, g=scale * g, a=A, lba=ends[:, 0], uba=ends[:, 1], lbx=lower, ubx=upper)
    if not other.stats()["success"]:
        return None
    forces = np.asarray(answer["lam_a"])[: 3 * N, 0] / scale
    forces[N:] /= unit
    return np.asarray(answer["x"])[:N, 0], np.column_stack((forces[:N], forces[N:].reshape(N, 2)))


@pytest.mark.parametrize("compiled", FORMS)
def test_it_agrees_with_another_solver_where_limits_are_soft(compiled: bool) -> None:
    active = left = 0
    for seed in range(60):
        stages, fences = fenced_stages(np.random.default_rng(seed), 20, 0.5)
        ours, residual = solver(2, 20, fenced=True).solve(stages, None, compiled, fences)
        theirs = by_others(stages, fences, hard=False)
        assert residual <= 1e-6
        assert theirs is not None
        assert np.all((ours >= stages.low - 1e-9) & (ours <= stages.high + 1e-9))
        assert np.max(excess(stages, fences, ours)[:, 0]) < 1e-9  # the rate is a hard limit
        best = cost(stages, fences, theirs[0])
        assert cost(stages, fences, ours) <= best + 1e-7 * abs(best) + 1e-12
        active += bool(np.any(np.abs(solver(2, 20, fenced=True).program.forces[:, 1:]) > 0))
        left += bool(np.any(excess(stages, fences, ours)[:, 1:] > 1e-6))
    assert active > 25
    assert left > 5


def test_the_price_is_exact_where_it_exceeds_the_multipliers() -> None:
    exact = 0
    for seed in range(80):
        stages, fences = fenced_stages(np.random.default_rng(seed), 20, 0.0)
        hard = by_others(stages, fences, hard=True)
        if hard is None or np.any(np.abs(hard[1][:, 1:]) > fences.prices[1:]):
            continue
        ours, _ = solver(2, 20, fenced=True).solve(stages, fences=fences)
        assert np.max(excess(stages, fences, ours) / fences.moved) < 1e-9
        best = cost(stages, fences, hard[0])
        assert cost(stages, fences, ours) == pytest.approx(best, rel=1e-7, abs=1e-12)
        exact += bool(np.any(hard[1][:, 1:] != 0.0))
    assert exact > 10


@settings(max_examples=30, deadline=None)
@given(seeds, st.floats(-1, 2))
def test_both_forms_find_the_same(seed: int, hardness: float) -> None:
    stages, fences = fenced_stages(np.random.default_rng(seed), 30, hardness)
    answers = [solver(2, 30, fenced=True).solve(stages, None, compiled, fences) for compiled in FORMS]
    assert np.array_equal(answers[0][0], answers[-1][0])
    assert answers[0][1] <= 1e-6


@settings(max_examples=30, deadline=None)
@given(seeds, st.floats(-1, 2))
def test_whatever_is_remembered_the_answer_is_the_same(seed: int, hardness: float) -> None:
    rng, both = np.random.default_rng(seed), solver(2, 30, fenced=True)
    stages, fences = fenced_stages(rng, 30, hardness)
    cold, residual = both.solve(stages, fences=fences)
    assert residual <= 1e-6
    for spoilt in (0.0, np.nan, np.inf, -1e200, -7.0):
        both.load(stages, rng.integers(-1, 2, 30), fences, rng.integers(-2, 3, (30, 4)))
        places = rng.random((2, 30, 4)) < 0.2
        both.program.pressed[places[0] & (spoilt != 0.0)] = spoilt
        both.program.forces[places[1]] = spoilt
        warm = both.machine_code() if FORMS[-1] else both.program.solve()
        assert warm <= 1e-6
        best = cost(stages, fences, cold)
        assert cost(stages, fences, both.arrays["e"]) == pytest.approx(best, rel=1e-7, abs=1e-12)


def test_the_active_set_follows_a_limit_that_moves() -> None:
    """Each step is warm-started with the last active set, so the interior point method is rarely used."""
    requested = []
    controller = Controller(ServoModel.paper(), GearTrain.paper(), horizon=30, angle_limits=(-0.2, 0.2))
    interpreted = controller._interpreted
    controller._step = interpreted
    inside = mpc.quadratic_program.solve_from_inside
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(mpc.quadratic_program, "solve_from_inside", lambda p: (requested.append(1), inside(p)))
        loop = closed_loop(controller, Rig.paper_like(), lambda t: 0.3 * (t > 0.1), 1.5, seed=0)
    assert loop.degraded == 0
    assert np.max(loop.angle) == pytest.approx(0.2, abs=1e-3)
    assert len(requested) <= 3


def test_a_force_that_is_wrong_is_not_certified() -> None:
    both = solver(2, 20, fenced=True)
    tried = (fenced_stages(np.random.default_rng(seed), 20, 0.5) for seed in range(100))
    stages, fences = next(found for found in tried if active(both, *found))
    assert both.solve(stages, fences=fences)[1] < 1e-6
    place = np.unravel_index(np.argmax(np.abs(both.program.forces[:, 1:] / fences.prices)), fences.ends.shape[:2])
    both.program.forces[:, 1:][place] *= 0.9
    assert both.program.residual() > 1e-3


def active(both: Solver, stages: Stages, fences: Fences) -> bool:
    both.solve(stages, fences=fences)
    return bool(np.max(np.abs(both.program.forces[:, 2:])) > 1e-3)


range_ = st.tuples(st.floats(-2, 2), st.floats(0, 1))  # least torque, width


@settings(deadline=None)
@given(st.lists(range_, min_size=1, max_size=30), st.floats(-3, 3), st.floats(0.01, 3))
def test_steps_of_that_size_lead_through_ranges(ranges: list[tuple[float, float]], last: float, step: float) -> None:
    reach = np.array([[low, low + width] for low, width in ranges])
    reached = np.array(within_rate([(low, high) for low, high in reach.tolist()], last, step), dtype=np.float64)
    tube, steps = reached[:, :2], reached[:, 2]
    assert np.all((tube >= reach[:, :1] - 1e-12) & (tube <= reach[:, 1:] + 1e-12))
    torque = [tube[-1, 0]]  # from any end of the tube there is a path backwards
    for k in range(len(reach) - 1, 0, -1):
        torque.append(float(np.clip(torque[-1], tube[k - 1, 0], tube[k - 1, 1])))
        assert abs(torque[-1] - torque[-2]) <= steps[k] + 1e-12
    assert abs(torque[-1] - last) <= steps[0] + 1e-12
    assert np.all(steps >= step)
    inside = (reach[:, 0] <= last) & (reach[:, 1] >= last)
    assert np.all(steps[inside.cumprod().astype(bool)] == step)  # the step is relaxed only if a range is out of reach
