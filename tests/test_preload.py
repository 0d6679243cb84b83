"""Preload in every unit: SEW's published examples, and there and back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from allocation import Allocator, Preload
from plant.errors import BadParameter
from plant.gears import GearTrain

DIRECT = GearTrain(pinion_teeth=(30, 30), output_teeth=30)
"""Output torque is minus the sum of the two torques, so SEW's demand counts negative here."""

teeth = st.integers(8, 200)
trains = st.builds(GearTrain, pinion_teeth=st.tuples(teeth, teeth), output_teeth=teeth)


# SEW's first drive stands at D2, for its tension is positive where the second drive gives more.


def test_sew_example_splits_120_nm_into_30_and_90() -> None:
    tension = Preload.from_percent(DIRECT, 50.0, rated_torque=120.0)
    second, first = tension.pinion_torques(-120.0)
    assert (first, second) == pytest.approx((30.0, 90.0))


def test_sew_example_without_demand_holds_plus_and_minus_30_nm() -> None:
    tension = Preload.from_percent(DIRECT, -50.0, rated_torque=120.0)
    second, first = tension.pinion_torques(0.0)
    assert (first, second) == pytest.approx((30.0, -30.0))
    assert tension.torques == pytest.approx([-30.0, 30.0])
    assert tension.difference == pytest.approx(-60.0)


@given(trains, st.floats(-1e3, 1e3), st.floats(1e-3, 1e3))
def test_every_unit_leads_back_to_lambda(gears: GearTrain, coefficient: float, rated: float) -> None:
    preload = Preload(gears=gears, coefficient=coefficient)
    others = (
        Preload.from_difference(gears, preload.difference),
        Preload.from_percent(gears, preload.percent(rated), rated_torque=rated),
        Preload.from_per_mille(gears, preload.per_mille(rated), rated_torque=rated),
    )
    for other in others:
        assert other.coefficient == pytest.approx(coefficient, rel=1e-12)
    assert preload.difference == pytest.approx(preload.torques[0] - preload.torques[1])
    assert preload.per_mille(rated) == pytest.approx(10 * preload.percent(rated))
    assert gears.output_torque(preload.torques) == pytest.approx(0.0, abs=1e-9 * (1 + abs(preload.difference)) * 200)


def test_it_is_the_preload_of_the_allocator() -> None:
    gears = GearTrain(pinion_teeth=(20, 31), output_teeth=161)
    shared = Allocator(gears, min_torque=0.02, max_torque=0.3).allocate(0.7)
    assert Preload(gears=gears, coefficient=shared.preload).pinion_torques(0.7) == pytest.approx(shared.torques)


def test_equal_gears_preload_is_half_the_difference_each() -> None:
    preload = Preload(gears=GearTrain.paper(), coefficient=0.01)
    assert preload.torques == pytest.approx([0.2, -0.2])
    assert preload.difference == pytest.approx(0.4)
    assert preload.percent(0.8) == pytest.approx(50.0)
    assert preload.per_mille(0.8) == pytest.approx(500.0)


def test_refuses_what_is_no_preload() -> None:
    with pytest.raises(BadParameter):
        Preload(gears=DIRECT, coefficient=np.nan)
    for rated in (0.0, -1.0, np.inf):
        with pytest.raises(BadParameter, match="rated_torque"):
            Preload.from_percent(DIRECT, 50.0, rated_torque=rated)
        with pytest.raises(BadParameter, match="rated_torque"):
            Preload(gears=DIRECT, coefficient=1.0).per_mille(rated)
