"""The gear train keeps equations (1) to (3) for any teeth."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant.errors import BadParameter
from plant.gears import GearTrain

teeth = st.integers(5, 400)
trains = st.builds(
    GearTrain,
    pinion_teeth=st.tuples(teeth, teeth),
    output_teeth=teeth,
    stages=st.lists(st.tuples(teeth, teeth), max_size=4).map(tuple),
)
torques = st.floats(-1e3, 1e3)


def test_the_papers_train() -> None:
    gears = GearTrain.paper()
    assert gears.ratio == pytest.approx(99.231, abs=5e-4)
    motor_speed = 2000 * 2 * np.pi / 60
    assert np.rad2deg(gears.load_speed(motor_speed)) == pytest.approx(120.9, abs=0.05)
    assert gears.torque_map == pytest.approx([-8.05, -8.05])
    assert gears.null_vector == pytest.approx([20, -20])
    # of unequal pinions the first one gives the ratio
    assert GearTrain(pinion_teeth=(20, 31), output_teeth=161, stages=((46, 23),)).ratio == pytest.approx(16.1)


def test_the_particular_solution_is_the_printed_one() -> None:
    gears = GearTrain(pinion_teeth=(20, 31), output_teeth=161)
    n1, n2, nf = 20, 31, 161
    expected = np.array([-n1 * n2**2, -(n1**2) * n2]) / (nf * (n1**2 + n2**2)) * 3.0
    assert gears.particular(3.0) == pytest.approx(expected, rel=1e-14)


@given(trains, torques, torques)
def test_the_split_gives_the_torque_whatever_the_preload(gears: GearTrain, torque: float, preload: float) -> None:
    xi = gears.pinion_torques(torque, preload)
    scale = np.abs(gears.torque_map) @ np.abs(xi) + abs(torque)
    assert gears.output_torque(xi) == pytest.approx(torque, abs=1e-12 * scale + 1e-12)


@given(trains)
def test_the_null_vector_moves_nothing_and_opposes_the_drives(gears: GearTrain) -> None:
    assert gears.torque_map @ gears.null_vector == pytest.approx(0.0, abs=1e-9)
    assert gears.null_vector[0] > 0 > gears.null_vector[1]


@given(trains, torques)
def test_the_particular_solution_is_the_one_of_least_norm(gears: GearTrain, torque: float) -> None:
    expected = np.linalg.pinv(gears.torque_map[None, :])[:, 0] * torque
    assert gears.particular(torque) == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert gears.particular(torque) @ gears.null_vector == pytest.approx(0.0, abs=1e-9 * (1 + abs(torque)))


@given(trains, torques, torques, st.floats(-50, 50))
def test_the_meshes_lose_no_power(gears: GearTrain, torque: float, preload: float, load_speed: float) -> None:
    xi = gears.pinion_torques(torque, preload)
    pinion_power = xi @ (gears.angle_map * load_speed)
    scale = np.abs(xi) @ np.abs(gears.angle_map * load_speed) + abs(torque * load_speed)
    assert pinion_power == pytest.approx(torque * load_speed, abs=1e-12 * scale + 1e-12)


@given(trains)
def test_a_large_enough_preload_holds_the_sense(gears: GearTrain) -> None:
    for torque in (-7.0, 0.0, 7.0):
        enough = 1 + np.max(np.abs(gears.particular(torque) / gears.null_vector))
        assert np.all(np.sign(gears.pinion_torques(torque, enough)) == [1, -1])
        assert np.all(np.sign(gears.pinion_torques(torque, -enough)) == [-1, 1])


def test_splits_many_torques_at_once() -> None:
    gears = GearTrain(pinion_teeth=(20, 31), output_teeth=161)
    torque, preload = np.array([-1.0, 0.0, 2.0]), np.array([0.1, 0.2, 0.3])
    together = gears.pinion_torques(torque, preload)
    assert together.shape == (3, 2)
    for row, tau, lam in zip(together, torque, preload, strict=True):
        assert row == pytest.approx(gears.pinion_torques(tau, lam))
    assert gears.pinion_torques(torque, 0.1).shape == (3, 2)


@pytest.mark.parametrize(
    "bad",
    [
        {"pinion_teeth": (0, 20)},
        {"pinion_teeth": (20, -3)},
        {"pinion_teeth": (20, 20.5)},
        {"pinion_teeth": (20, True)},
        {"pinion_teeth": (20,)},
        {"output_teeth": 0},
        {"stages": ((46,),)},
        {"stages": ((46, 0),)},
    ],
)
def test_refuses_teeth_that_cannot_be(bad: dict[str, object]) -> None:
    good: dict[str, object] = {"pinion_teeth": (20, 20), "output_teeth": 161}
    with pytest.raises(BadParameter):
        GearTrain(**{**good, **bad})  # type: ignore[arg-type]
