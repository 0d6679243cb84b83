"""The allocator after the loss of drives: it continues with the others and reports the loss."""

from __future__ import annotations

import numpy as np
import pytest
from machines import admissible_matrix
from scipy.optimize import linprog

from allocation import Allocator
from allocation.loss import still_preloaded
from allocation.structure import Structure
from plant.gears import GearTrain

PAPER = GearTrain.paper()
PAIRS = [[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]]
"""Two joints with a pair of drives each."""

STAR = [[1.0, np.cos(1.8), np.cos(2.6), np.cos(4.4)], [0.0, np.sin(1.8), np.sin(2.6), np.sin(4.4)]]
"""Two joints with four drives: the others keep contact without the second or the third."""


@pytest.mark.parametrize("drive", [1, 2])
@pytest.mark.parametrize("solver", [None, "osqp"])
def test_one_drive_of_two_keeps_the_motion_in_both_senses(drive: int, solver: str | None) -> None:
    whole = Allocator(PAPER, min_torque=0.02, max_torque=0.3, solver=solver)
    alone = whole.without(drive)
    for torque in (-1.0, 0.0, 1.0):
        result = alone.allocate(torque)
        assert result.torques[drive - 1] == 0.0
        assert PAPER.output_torque(result.torques) == pytest.approx(torque)
        assert result.missing_torque == pytest.approx(0.0, abs=1e-12)
        assert result.status == f"degraded: drive {drive} is lost, and backlash control with it"
        assert result.margin < 0.0
        assert not result.is_optimal(1.0)
    far = alone.allocate(3.0)
    assert abs(far.torques[2 - drive]) == pytest.approx(0.3)
    assert far.missing_torque == pytest.approx(3.0 - 8.05 * 0.3)
    assert f"drive {drive}: lost" in far.binding
    assert whole.allocate(1.0).status == "optimal"


def test_a_drive_that_cannot_reverse_gives_what_it_can() -> None:
    alone = Allocator(PAPER, min_torque=0.02, max_torque=0.3, reverse_torque=0.0).without(2)
    pushes, cannot = alone.allocate(-1.0), alone.allocate(1.0)
    assert pushes.torques == pytest.approx([1 / 8.05, 0.0])
    assert cannot.torques.tolist() == [0.0, 0.0]
    assert cannot.missing_torque == pytest.approx(1.0)
    assert "drive 1: reverse torque" in cannot.binding
    some = Allocator(PAPER, min_torque=0.02, max_torque=0.3, reverse_torque=(0.1, 0.0), lost=(2,)).allocate(2.0)
    assert some.torques == pytest.approx([-0.1, 0.0])


def test_the_other_joint_keeps_its_preload() -> None:
    result = Allocator(PAIRS, min_torque=0.02, max_torque=0.3).without(4).allocate([0.1, -0.2])
    assert result.torques == pytest.approx([0.12, 0.02, -0.2, 0.0])
    assert result.status == "degraded: drive 4 is lost, and the backlash control of drive 3 with it"
    both = Allocator(PAIRS, min_torque=0.02, max_torque=0.3, lost=(1, 4)).allocate([0.1, -0.2])
    assert both.torques == pytest.approx([0.0, -0.1, -0.2, 0.0])
    assert both.status == "degraded: drives 1 and 4 are lost, and backlash control with it"


def test_a_structure_may_have_a_drive_to_spare() -> None:
    whole = Allocator(STAR, min_torque=0.02, max_torque=0.3)
    rest = whole.without(2).allocate([0.05, -0.05])
    assert rest.status == "degraded: drive 2 is lost, the others still keep contact"
    assert np.all(rest.torques[[0, 2, 3]] >= 0.02)
    assert np.array(STAR) @ rest.torques == pytest.approx([0.05, -0.05])
    worse = whole.without(2).without(4).allocate([0.05, -0.05])
    assert "drives 2 and 4 are lost, and backlash control" in worse.status
    assert np.array(STAR) @ worse.torques == pytest.approx([0.05, -0.05])


def test_preload_is_held_by_the_drives_of_a_null_vector() -> None:
    rng = np.random.default_rng(7)
    kept = 0
    for _ in range(30):
        A = admissible_matrix(rng, 2, 4)
        lost = int(rng.integers(1, 5))
        alive = [i for i in range(4) if i != lost - 1]
        expected = np.zeros(4, dtype=bool)
        for i in alive:  # can the others balance one newton metre of drive i?
            others = [j for j in alive if j != i]
            expected[i] = linprog(np.zeros(2), A_eq=A[:, others], b_eq=-A[:, i]).status == 0
        assert still_preloaded(Structure(A), (lost,)).tolist() == expected.tolist()
        kept += int(np.sum(expected))
    assert 0 < kept < 90


def test_a_drive_loss_in_motion_is_answered_at_once() -> None:
    whole = Allocator(PAPER, min_torque=0.02, max_torque=0.3, torque_rate=10.0, preload_rate=1.0)
    before = whole.allocate(1.0)
    after = whole.without(2).allocate(1.0, before=before, dt=0.005)
    assert after.torques == pytest.approx([before.torques[0] - 0.05, 0.0])
    assert "torque_rate" not in after.status  # there is no preload left
