"""The allocator compared with its closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import qpsolvers
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import allocation.general_allocation
from allocation import Allocator, Bounds, InfeasibleTorque, least_effort
from plant.errors import AntidriveError, BadParameter
from plant.gears import GearTrain

Array = NDArray[np.float64]

teeth = st.integers(8, 200)
trains = st.builds(GearTrain, pinion_teeth=st.tuples(teeth, teeth), output_teeth=teeth)
scales = st.sampled_from([0.01, 0.3, 100.0])
PAPER = GearTrain.paper()


def box_violation(allocator: Allocator, torques: Array) -> float:
    """Violation of the hard bounds by pinion torques [N m]."""
    magnitudes = torques * [1, -1]
    return float(np.max(np.maximum(allocator.min_torque - magnitudes, magnitudes - allocator.max_torque)))


@settings(max_examples=150, deadline=None)
@given(
    gears=trains,
    scale=scales,
    share=st.floats(-0.2, 1.2),
    least=st.floats(0.0, 0.9),
    weights=st.tuples(st.floats(0.1, 10), st.floats(0.1, 10)),
    rotor=st.floats(0, 0.2),
    acceleration=st.floats(-3, 3),
)
def test_the_qp_agrees_with_the_closed_form(
    gears: GearTrain,
    scale: float,
    share: float,
    least: float,
    weights: tuple[float, float],
    rotor: float,
    acceleration: float,
) -> None:
    allocator = Allocator(
        gears,
        min_torque=least * scale,
        max_torque=scale,
        weights=weights,
        rotor_inertia=rotor * scale / float(np.max(gears.mesh_ratios)),
        solver="osqp",
    )
    low, high = allocator.bounds.reachable(acceleration)
    torque = float(low + share * (high - low))
    result = allocator.allocate(torque, acceleration)
    expected = least_effort(allocator.bounds, torque, acceleration, weights)
    assert result.torques == pytest.approx(expected, abs=1e-9 * scale)
    assert replace(allocator, solver=None).allocate(torque, acceleration).torques == pytest.approx(expected)
    assert box_violation(allocator, result.torques) <= 0.0
    assert "certified" not in result.status
    reached = np.clip(torque, low, high)
    missing = torque - gears.output_torque(expected)
    assert missing == pytest.approx(torque - reached, abs=1e-9 * scale * np.max(gears.mesh_ratios))


@pytest.mark.parametrize("solver", [None, "osqp"])
@pytest.mark.parametrize("scale", [0.01, 100.0])
def test_small_and_large_machines_are_solved_alike(scale: float, solver: str | None) -> None:
    allocator = Allocator(PAPER, min_torque=0.05 * scale, max_torque=scale, solver=solver)
    for share in np.linspace(-0.95, 0.95, 39):
        torque = float(share * 8.05 * 0.95 * scale)
        result = allocator.allocate(torque)
        assert result.is_optimal(1e-9)
        assert result.torques == pytest.approx(least_effort(allocator.bounds, torque), abs=1e-9 * scale)
        assert abs(result.missing_torque) < 1e-9 * scale
        assert result.margin >= 0.0


@given(trains, st.floats(-1, 1), st.floats(0.0, 0.5), st.tuples(st.floats(0.1, 10), st.floats(0.1, 10)))
def test_the_closed_form_is_the_best_of_all_preloads(
    gears: GearTrain, share: float, least: float, weights: tuple[float, float]
) -> None:
    bounds = Bounds(gears=gears, min_torque=least, max_torque=1.0)
    low, high = bounds.reachable()
    torque = low + (high - low) * (0.5 + 0.49 * share)
    best = least_effort(bounds, torque, weights=weights)
    every = gears.pinion_torques(torque, np.linspace(-1, 1, 4001) * 2 / min(gears.pinion_teeth))
    magnitudes = every * [1, -1]
    feasible = every[np.all((magnitudes >= least) & (magnitudes <= 1.0), axis=1)]
    effort = feasible**2 @ np.array(weights)
    assert best**2 @ np.array(weights) <= np.min(effort, initial=np.inf) + 1e-9
    assert gears.output_torque(best) == pytest.approx(torque, abs=1e-9 * np.max(gears.mesh_ratios))


def test_equal_gears_give_the_known_copper_loss() -> None:
    allocator = Allocator(PAPER, min_torque=0.02, max_torque=0.3)
    result = allocator.allocate(1.0)
    n, teeth_of_pinion = 161 / 20, 20
    preload_torque = result.preload * teeth_of_pinion
    assert result.copper_loss == pytest.approx((1.0 / n) ** 2 / 2 + 2 * preload_torque**2, rel=1e-6)
    assert result.torques[0] == pytest.approx(0.02)


def test_the_preload_comes_before_the_torque() -> None:
    allocator = Allocator(PAPER, min_torque=0.02, max_torque=0.3)
    greatest = 8.05 * (0.3 - 0.02)
    result = allocator.allocate(greatest + 1.0)
    assert result.torques == pytest.approx([0.02, -0.3], abs=1e-8)
    assert result.missing_torque == pytest.approx(1.0, abs=1e-6)
    assert result.status.startswith("degraded")
    assert "1 N m" in result.status
    assert not result.is_optimal(1e-3)


def test_contact_torque_counts_the_rotor() -> None:
    rotor = 1e-5
    allocator = Allocator(PAPER, min_torque=0.02, max_torque=0.3, rotor_inertia=rotor)
    taken = rotor * PAPER.pre_reduction**2 * 8.05 * 3.0  # torque of a rotor at 3 rad/s^2, seen from the pinion
    forward, backward = allocator.allocate(-1.0, 3.0), allocator.allocate(-1.0, -3.0)
    # forward acceleration requires more torque of the forward drive (2), which only keeps contact here
    assert -forward.torques[1] == pytest.approx(0.02 + taken, abs=1e-7)
    # backward acceleration increases the contact torque of drive 2, but its motor must keep its minimum torque
    assert -backward.torques[1] == pytest.approx(0.02, abs=1e-7)
    assert forward.margin == pytest.approx(0.0, abs=1e-7)
    # a motor at its minimum torque has no margin, however large its contact torque
    assert backward.margin == pytest.approx(0.0, abs=1e-7)


def test_an_accelerating_rotor_takes_torque_from_its_drive() -> None:
    rotor, unequal = 1e-5, GearTrain(pinion_teeth=(20, 31), output_teeth=161, stages=PAPER.stages)
    bounds = Bounds(gears=unequal, min_torque=0.02, max_torque=0.3, rotor_inertia=rotor)
    n1, n2 = 161 / 20, 161 / 31
    taken_1, taken_2 = (rotor * PAPER.pre_reduction**2 * n * 3.0 for n in (n1, n2))
    assert bounds.reachable(3.0) == pytest.approx([n2 * (0.02 + taken_2) - n1 * 0.3, n2 * 0.3 - n1 * 0.02])
    assert bounds.reachable(-3.0) == pytest.approx([n2 * 0.02 - n1 * 0.3, n2 * 0.3 - n1 * (0.02 + taken_1)])


def test_reports_when_the_flank_cannot_be_held() -> None:
    allocator = Allocator(PAPER, min_torque=0.02, max_torque=0.3, rotor_inertia=1e-5)
    result = allocator.allocate(0.0, 1e3)
    assert "acceleration" in result.status
    assert result.margin < 0.0
    assert box_violation(allocator, result.torques) <= 0.0
    # the drive that loses contact gives its greatest torque; the other one gets as near to the demand as possible
    assert allocator.allocate(-1.0, 1e3).torques == pytest.approx([0.3, -0.3], abs=1e-8)


def test_no_torques_at_all_are_refused() -> None:
    with pytest.raises(InfeasibleTorque, match="min_torque"):
        Allocator(PAPER, min_torque=0.4, max_torque=0.3)
    assert issubclass(InfeasibleTorque, AntidriveError)


@pytest.mark.parametrize(
    "bad",
    [
        {"min_torque": -0.1},
        {"max_torque": 0.0, "min_torque": 0.0},
        {"max_torque": float("inf")},
        {"weights": (1.0, 0.0)},
        {"weights": (1.0,)},
        {"solver": "no such solver"},
        {"rotor_inertia": float("nan")},
    ],
)
def test_refuses_parameters_that_cannot_be(bad: dict[str, object]) -> None:
    good: dict[str, object] = {"min_torque": 0.02, "max_torque": 0.3}
    with pytest.raises(BadParameter):
        Allocator(PAPER, **{**good, **bad})  # type: ignore[arg-type]


def test_refuses_a_torque_that_is_not_a_number() -> None:
    with pytest.raises(BadParameter):
        Allocator(PAPER, min_torque=0.02, max_torque=0.3).allocate(float("nan"))


@pytest.mark.parametrize("failure", ["not found", "lies", "nan", "raises"])
@pytest.mark.parametrize("torque", [1.0, 9.0])
def test_a_solver_that_fails_cannot_pass(monkeypatch: pytest.MonkeyPatch, failure: str, torque: float) -> None:
    def broken(problem: qpsolvers.Problem, *_: object, **__: object) -> qpsolvers.Solution:
        if failure == "raises":
            raise ZeroDivisionError
        solution = qpsolvers.Solution(problem)
        if failure != "not found":
            solution.found = True
            solution.x = np.full(3, 0.9 if failure == "lies" else np.nan)
            solution.y, solution.z, solution.z_box = np.zeros(1), np.zeros(0), np.zeros(3)
        return solution

    allocator = Allocator(PAPER, min_torque=0.02, max_torque=0.3, solver="osqp")
    monkeypatch.setattr(qpsolvers, "solve_problem", broken)
    result = allocator.allocate(torque)
    assert "osqp was not certified, the exact method is used" in result.status
    assert not result.is_optimal(1.0)
    assert result.torques == pytest.approx(least_effort(allocator.bounds, torque), abs=1e-12)


def test_an_answer_without_proof_keeps_the_preload_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(allocation.general_allocation, "solve_exactly", lambda *_: np.full(2, 0.5))
    allocator = Allocator(PAPER, min_torque=0.02, max_torque=0.3, solver="osqp")
    result = allocator.allocate(1.0)
    assert result.torques.tolist() == [0.02, -0.02]
    assert "not certified, the preload alone is used" in result.status
    assert not result.is_optimal(1e9)
    assert result.margin == 0.0


def test_a_point_that_is_not_complementary_is_not_optimal() -> None:
    # x = 5 is feasible, and the multiplier of an inactive bound balances its gradient
    solution = qpsolvers.Solution(qpsolvers.Problem(np.eye(1), -np.ones(1), lb=np.zeros(1), ub=np.full(1, 10.0)))
    solution.found, solution.x = True, np.full(1, 5.0)
    solution.y, solution.z, solution.z_box = np.zeros(0), np.zeros(0), np.full(1, -4.0)
    assert max(solution.primal_residual(), solution.dual_residual()) == 0.0
    assert allocation.qp.largest_residual(solution) == pytest.approx(20.0)
