"""The allocator on any structure: compared with a search over all sets of active rows, and at its limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import qpsolvers
from machines import admissible_matrix, best_by_trying, random_allocator
from numpy.typing import NDArray
from scipy.optimize import linprog

from allocation import Allocator, InfeasibleTorque, Structure
from allocation.least_effort import share_between_two
from allocation.quadratic_program import QuadraticProgram
from plant.errors import BadParameter
from plant.gears import GearTrain

Array = NDArray[np.float64]

PAPER = GearTrain.paper()
THREE = [[1.0, -1.0, 0.4], [0.3, 0.6, -1.0]]
"""Two joints, three drives."""


@pytest.mark.parametrize(("n", "m", "scale"), [(1, 2, 0.01), (2, 3, 1.0), (2, 4, 100.0), (3, 4, 1.0), (3, 5, 1.0)])
def test_no_set_of_active_rows_is_better(n: int, m: int, scale: float) -> None:
    rng = np.random.default_rng(10 * n + m)
    reached = 0
    for _ in range(40 if m < 5 else 15):
        allocator = random_allocator(rng, n, m, scale)
        bounds, B = allocator.bounds, allocator.bounds.structure.pushing
        torque = scale * B @ rng.uniform(-0.2, 1.2, m)
        a = rng.normal(size=n) if n > 1 else rng.normal()
        lower = np.minimum(bounds.lower(a), bounds.greatest)
        result = allocator.allocate(torque, a)
        weights = np.array(allocator.weights)
        expected = best_by_trying(B, torque / scale, lower / scale, bounds.greatest / scale, weights)
        assert result.torques == pytest.approx(scale * expected, abs=1e-9 * scale)
        assert np.all(result.torques >= lower)
        assert np.all(result.torques <= bounds.greatest)
        assert result.missing_torque == pytest.approx(np.squeeze(torque - B @ result.torques), abs=1e-12 * scale)
        assert max(result.primal_residual, result.dual_residual, result.duality_gap) <= 1e-9
        reached += result.is_optimal(1e-9)
    assert reached > 0


@pytest.mark.parametrize("beyond", [0.0, 1e-15, 1e-12, 1e-10, 1e-8, 1e-4])
def test_the_edge_of_reach_is_answered_from_both_sides(beyond: float) -> None:
    rng = np.random.default_rng(4)
    for n, m in ((1, 2), (2, 3), (2, 4)) * 10:
        allocator = replace(random_allocator(rng, n, m), solver="osqp")
        bounds, B = allocator.bounds, allocator.bounds.structure.pushing
        direction = rng.normal(size=n)
        corner = np.where(direction @ B > 0, bounds.greatest, bounds.floor)
        torque = B @ corner + beyond * rng.choice([-1.0, 1.0]) * direction
        result = allocator.allocate(torque)
        expected = best_by_trying(B, torque, bounds.floor, bounds.greatest, np.array(allocator.weights))
        assert B @ result.torques == pytest.approx(B @ expected, abs=1e-9)
        assert max(result.primal_residual, result.dual_residual, result.duality_gap) <= 1e-9
        assert "not certified" not in result.status


def test_the_proof_holds_for_the_answer_and_for_no_other_point() -> None:
    rng = np.random.default_rng(6)
    for reach in (0.9, 3.0):  # reachable and unreachable demands
        for _ in range(20):
            B, x_any = admissible_matrix(rng, 2, 4), rng.uniform(0.1, reach, 4)
            B /= np.linalg.norm(B)
            lower, upper = np.full(4, 0.1), np.ones(4)
            C, d = np.vstack((np.eye(4), -np.eye(4))), np.concatenate((upper, -lower))
            program = QuadraticProgram(B=B, b=B @ x_any, w=rng.uniform(0.1, 1.0, 4), C=C, d=d)
            best = best_by_trying(B, program.b, lower, upper, program.w)
            assert program.residuals(best).largest < 1e-10
            if reach < 1:  # meets the demand, with more preload than necessary
                assert program.residuals(x_any).largest > 1e-3
            for size in (1e-6, 1e-2, 1.0):
                other = np.clip(best + size * rng.normal(size=4), lower, upper)
                moved = float(np.max(np.abs(other - best)))  # zero if the point is clipped back to a corner
                assert moved < size / 100 or program.residuals(other).largest > 1e-9
                assert program.residuals(best + size * np.array([1, 0, 0, 0])).largest > 1e-9


def test_the_closed_form_knows_boxes_of_any_kind() -> None:
    rng = np.random.default_rng(9)
    for _ in range(200):
        pushing, weights = rng.uniform(0.2, 5.0, 2) * [-1, 1], rng.uniform(0.1, 10.0, 2)
        lower = rng.uniform(-1.0, 0.5, 2)  # also reversible drives: then the vertex of the effort matters
        upper = lower + rng.uniform(0.0, 1.0, 2)
        torque = pushing @ rng.uniform(-1.5, 1.5, 2)
        shared = share_between_two(pushing, torque, lower, upper, weights)
        best = best_by_trying(pushing[None], np.array([torque]), lower, upper, weights)
        assert shared == pytest.approx(best, abs=1e-9)


def test_two_drives_agree_as_gears_as_matrix_and_by_both_solvers() -> None:
    gears = Allocator(PAPER, min_torque=0.02, max_torque=0.3)
    ways = [
        gears,
        replace(gears, solver="osqp"),
        Allocator([[-8.05, 8.05]], min_torque=0.02, max_torque=0.3),
        Allocator(Structure([[-8.05, -8.05]], directions=(1, -1)), min_torque=0.02, max_torque=0.3),
    ]
    for torque in (-1.0, 0.3, 9.0):
        first, *others = [way.allocate(torque) for way in ways]
        for other in others:
            assert np.abs(other.torques) == pytest.approx(np.abs(first.torques), abs=1e-12)
            assert other.binding == first.binding
            assert other.missing_torque == pytest.approx(first.missing_torque, abs=1e-12)
        assert first.torques[1] < 0 < first.torques[0]


def test_missing_joint_torques_are_reported_briefly() -> None:
    allocator = Allocator(THREE, min_torque=0.05, max_torque=1.0)
    demand = np.array([3.0, 1.0])
    result = allocator.allocate(demand)
    assert result.missing_torque == pytest.approx(demand - np.array(THREE) @ result.torques)
    assert result.status.startswith("degraded: ")
    assert f"{np.linalg.norm(result.missing_torque):.3g} N m of the torque are out of reach" in result.status
    assert set(result.binding) == {"drive 1: greatest torque", "drive 2: minimum torque"}
    # no reachable torque is nearer: the missing part points away from all of them (a support function)
    direction = np.asarray(result.missing_torque)
    furthest = linprog(-direction @ np.array(THREE), bounds=[(0.05, 1.0)] * 3)
    assert -furthest.fun == pytest.approx(direction @ np.array(THREE) @ result.torques)


def test_preload_moves_nothing_along_the_null_direction() -> None:
    allocator = Allocator(THREE, min_torque=0.05, max_torque=1.0)
    v = allocator.bounds.structure.null_vector
    assert np.array(THREE) @ v == pytest.approx(np.zeros(2), abs=1e-12)
    assert np.max(v) == 1.0
    still = allocator.allocate([0.0, 0.0])
    assert still.torques == pytest.approx(still.preload * v)
    assert np.min(still.torques) == pytest.approx(0.05)


# Contact torques.


def test_contact_torque_counts_rotor_and_friction() -> None:
    rotor, friction, r = 1e-5, 1e-3, PAPER.pre_reduction
    allocator = Allocator(PAPER, min_torque=0.02, max_torque=0.3, rotor_inertia=rotor, motor_friction=friction)
    taken = rotor * r**2 * 8.05 * 3.0
    still, forward, backward = (allocator.allocate(-1.0, a) for a in (0.0, 3.0, -3.0))
    assert -still.torques[1] == pytest.approx(0.02 + friction * r)
    assert -forward.torques[1] == pytest.approx(0.02 + friction * r + taken)
    # the rotor inertia increases the contact torque by more than friction reduces it: the motor's minimum is active
    assert taken > friction * r
    assert -backward.torques[1] == pytest.approx(0.02)
    assert "drive 2: contact torque" in forward.binding
    assert "drive 2: minimum torque" in backward.binding
    assert forward.margin == pytest.approx(0.0, abs=1e-12)
    bare = replace(allocator, motor_friction=0.0).allocate(-1.0, 3.0)
    assert allocator.bounds.margin(bare.torques, 3.0) == pytest.approx(-friction * r)


def test_rotors_of_several_joints_follow_the_transposed_map() -> None:
    allocator = Allocator(THREE, min_torque=0.05, max_torque=1.0, rotor_inertia=(0.01, 0.02, 0.03))
    a = np.array([1.5, -0.5])
    taken = np.array([0.01, 0.02, 0.03]) * (np.array(THREE).T @ a)
    assert allocator.bounds.lower(a) == pytest.approx(0.05 + np.maximum(taken, 0.0))
    many = allocator.bounds.lower(np.array([a, 2 * a]))
    assert many[1] == pytest.approx(0.05 + np.maximum(2 * taken, 0.0))


# Invalid arguments, and other solvers.


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"gears": [[1.0, 1.0]]}, "null vector"),
        ({"gears": [[1.0, -1.0], [2.0, -2.0]]}, "null vector"),
        ({"min_torque": (0.1, 0.1)}, "3 drives"),
        ({"weights": (1.0, 0.0, 1.0)}, "weights"),
        ({"torque_rate": 0.0}, "torque_rate"),
        ({"preload_rate": float("nan")}, "preload_rate"),
        ({"reverse_torque": -1.0}, "reverse_torque"),
        ({"motor_friction": float("inf")}, "motor_friction"),
        ({"lost": (4,)}, "lost"),
        ({"lost": (1, 1)}, "lost"),
        ({"lost": (1, 2, 3)}, "lost"),
        ({"solver": "pencil"}, "pencil"),
    ],
)
def test_refuses_what_cannot_be(bad: dict[str, object], message: str) -> None:
    good: dict[str, object] = {"gears": THREE, "min_torque": 0.02, "max_torque": 0.3}
    with pytest.raises(BadParameter, match=message):
        Allocator(**{**good, **bad})  # type: ignore[arg-type]


def test_reports_which_drive_has_crossed_limits() -> None:
    with pytest.raises(InfeasibleTorque, match="drive 2"):
        Allocator(THREE, min_torque=(0.1, 0.4, 0.1), max_torque=0.3)


@pytest.mark.parametrize(
    ("torque", "more", "message"),
    [
        (1.0, {}, "2 joints"),
        ([1.0, 2.0, 3.0], {}, "2 joints"),
        ([1.0, np.nan], {}, "finite"),
        ([1.0, 1.0], {"acceleration": 1.0}, "acceleration"),
        ([1.0, 1.0], {"before": True}, "dt"),
        ([1.0, 1.0], {"before": True, "dt": -1.0}, "dt"),
        ([1.0, 1.0], {"before": False, "dt": 0.1}, "2 torques"),
    ],
)
def test_refuses_demands_that_do_not_fit(torque: object, more: dict[str, object], message: str) -> None:
    allocator = Allocator(THREE, min_torque=0.02, max_torque=0.3)
    if "before" in more:
        more = {
            **more,
            "before": (allocator if more["before"] else Allocator(PAPER, min_torque=0, max_torque=1)).at_rest(),
        }
    with pytest.raises(BadParameter, match=message):
        allocator.allocate(torque, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "solver", sorted({"osqp", "clarabel", "daqp", "piqp", "proxqp", "quadprog"} & {*qpsolvers.available_solvers})
)
def test_every_solver_gives_the_same_answer(solver: str) -> None:
    rng = np.random.default_rng(8)
    for n, m in ((1, 2), (2, 3), (2, 4)):
        for _ in range(10):
            allocator = random_allocator(rng, n, m)
            A = allocator.bounds.structure.matrix
            torque = A @ rng.uniform(-0.2, 1.2, m)
            named, default = (replace(allocator, solver=name).allocate(torque) for name in (solver, None))
            assert named.torques == pytest.approx(default.torques, abs=1e-9)
            assert "not certified" not in named.status
