"""The allocator from one step to the next: rate limits, and build-up and release of the preload."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from machines import DT, random_allocator, requests, two_drives
from numpy.typing import NDArray
from scipy.optimize import minimize

from allocation import Allocation, Allocator, least_effort
from plant.gears import GearTrain

Array = NDArray[np.float64]

PAPER = GearTrain.paper()


def stepped(allocator: Allocator, torque: Array, count: int, dt: float = 0.005) -> list[Allocation]:
    results = [allocator.at_rest()]
    for _ in range(count):
        results.append(allocator.allocate(torque, before=results[-1], dt=dt))
    return results[1:]


@pytest.mark.parametrize("solver", [None, "osqp"])
def test_the_preload_is_built_up_before_the_torque_comes(solver: str | None) -> None:
    allocator = Allocator(PAPER, min_torque=0.05, max_torque=0.3, preload_rate=2.0, solver=solver)
    results = stepped(allocator, np.array(1.0), 15)
    torques = np.array([r.torques for r in results])
    for k in range(4):  # 0.01 N m per step, up to 0.05
        assert torques[k] == pytest.approx([0.01 * (k + 1), -0.01 * (k + 1)])
        assert "being built up" in results[k].status
        assert results[k].missing_torque == pytest.approx(1.0)
        assert "preload rate" in results[k].binding
    assert results[4].margin == pytest.approx(0.0, abs=1e-12)
    assert np.all(np.diff([r.missing_torque for r in results[4:]]) <= 1e-12)
    assert results[-1].is_optimal(1e-9)
    assert results[-1].torques == pytest.approx(least_effort(allocator.bounds, 1.0))
    preload = 20 * np.array([r.preload for r in results])
    assert np.max(np.abs(np.diff(preload, prepend=0.0))) <= 2.0 * 0.005 + 1e-12


@pytest.mark.parametrize("solver", [None, "osqp"])
def test_torques_keep_their_rate(solver: str | None) -> None:
    allocator = Allocator(PAPER, min_torque=0.05, max_torque=0.3, torque_rate=4.0, solver=solver)
    results = stepped(allocator, np.array(-1.5), 15)
    torques = np.array([np.zeros(2), *(r.torques for r in results)])
    assert np.max(np.abs(np.diff(torques, axis=0))) <= 4.0 * 0.005 + 1e-12
    assert "torque_rate holds the preload back" in results[0].status
    assert results[0].torques == pytest.approx([0.02, -0.02])
    assert results[3].binding == ("drive 2: minimum torque", "drive 1: torque rate")
    assert "(drive 2: minimum torque, drive 1: torque rate)" in results[3].status
    assert results[-1].is_optimal(1e-9)
    turned = allocator.allocate(1.5, before=results[-1], dt=0.005)
    assert turned.torques - results[-1].torques == pytest.approx([-0.02, -0.02])


def test_a_flank_that_needs_it_gets_its_preload_at_once() -> None:
    allocator = Allocator(PAPER, min_torque=0.02, max_torque=0.3, rotor_inertia=1e-5, preload_rate=0.01)
    now = allocator.allocate(0.5)
    jerked = allocator.allocate(0.5, -20.0, before=now, dt=0.005)
    assert jerked.margin == pytest.approx(0.0, abs=1e-12)
    assert jerked.torques[0] > now.torques[0] + 0.02


def test_a_preload_is_let_go_at_its_rate() -> None:
    allocator = Allocator(PAPER, min_torque=0.05, max_torque=0.3, preload_rate=2.0)
    now, slack = allocator.allocate(0.0), replace(allocator, min_torque=0.0)
    for k in range(1, 6):
        now = slack.allocate(0.0, before=now, dt=0.005)
        assert now.torques == pytest.approx([0.05 - 0.01 * k, -0.05 + 0.01 * k], abs=1e-12)


@pytest.mark.parametrize(("n", "m"), [(1, 2), (2, 3), (2, 4), (3, 6)])
def test_rates_hold_on_any_structure_and_the_answer_is_proven(n: int, m: int) -> None:
    rng = np.random.default_rng(m)
    for _ in range(6):
        allocator = replace(
            random_allocator(rng, n, m),
            motor_friction=0.0,
            torque_rate=rng.uniform(5, 40),
            preload_rate=rng.uniform(5, 40),
        )
        A, P = allocator.bounds.structure.matrix, allocator.bounds.structure.null_space
        now = allocator.at_rest()
        for _ in range(12):
            last, now = now, allocator.allocate(A @ rng.uniform(0, 0.9, m), before=now, dt=0.005)
            change = now.torques - last.torques
            assert np.max(np.abs(change)) <= allocator.torque_rate * 0.005 + 1e-12
            assert max(now.primal_residual, now.dual_residual, now.duality_gap) <= 1e-9
            least = allocator.bounds.least
            if np.all(last.torques >= least):  # built up: from now on within its rate limit and never lost
                assert np.max(np.abs(P @ (P.T @ change))) <= allocator.preload_rate * 0.005 + 1e-12
                assert np.all(now.torques >= least - 1e-15)


@pytest.mark.parametrize("scale", [pytest.param(0.01, marks=pytest.mark.long), 1.0, 100.0])
def test_both_ways_agree_to_a_billionth_of_rated_torque(scale: float) -> None:
    """A small version of benchmarks/allocation_agreement.py."""
    rng = np.random.default_rng(12)
    for _ in range(30):
        closed = two_drives(rng, scale)
        solved = replace(closed, solver="osqp")
        for ask in requests(rng, closed, 20):
            one, other = (
                way.allocate(ask.torque, ask.acceleration, before=ask.before, dt=DT) for way in (closed, solved)
            )
            assert other.torques == pytest.approx(one.torques, rel=0, abs=1e-9 * float(np.max(closed.bounds.greatest)))
            for way in (one, other):
                assert max(way.primal_residual, way.dual_residual, way.duality_gap) <= 1e-9


def test_the_effort_within_rates_is_the_least_by_another_solver() -> None:
    rng = np.random.default_rng(3)
    allocator = Allocator([[1, -1, 0.5, -0.5], [1, 1, -1, -1]], min_torque=0.05, max_torque=1.0, preload_rate=20.0)
    A, N = allocator.bounds.structure.matrix, allocator.bounds.structure.null_space
    before = allocator.allocate([0.2, -0.1])
    tight = 0
    for _ in range(10):
        torque = 0.4 * rng.normal(size=2)
        result = allocator.allocate(torque, before=before, dt=0.005)
        if result.status != "optimal":
            continue
        tight += "preload rate" in result.binding
        constraints = [
            {"type": "eq", "fun": lambda x, torque=torque: A @ x - torque},
            {"type": "ineq", "fun": lambda x: 0.1 - np.abs(N @ (N.T @ (x - before.torques)))},
        ]
        other = minimize(
            lambda x: x @ x, result.torques, bounds=[(0.05, 1.0)] * 4, constraints=constraints, options={"ftol": 1e-14}
        )
        assert other.success
        assert result.copper_loss == pytest.approx(other.fun, abs=1e-7)
    assert tight > 0
