"""A torque's course over an integration step, and two actuators behind one another."""

from __future__ import annotations

import numpy as np
import pytest
from machine import Machine, excitation, record

from plant import ServoModel
from plant.actuator import Course
from plant.effects import ActuatorLag, RateLimit
from plant.simulation import simulate


def test_a_linear_law_moves_the_whole_course() -> None:
    middles = (np.arange(12) + 0.5) / 12
    parabolic = Course(start=1.0, half=1.5, end=4.0, early=0.1, path=tuple(1.0 + 3.0 * middles**2))
    moved = parabolic.moved(2.0, -1.0)
    assert (moved.start, moved.half, moved.end, moved.early) == (1.0, 2.0, 7.0, 0.1)
    assert moved.along == pytest.approx(1.0 + 6.0 * middles**2)
    assert moved.mean == pytest.approx(2.0 * parabolic.mean - 1.0)
    straight = Course(start=1.0, half=2.5, end=4.0, early=0.0).moved(2.0, -1.0)
    assert straight.along == pytest.approx(1.0 + 6.0 * middles)


def test_a_lag_is_sampled_in_the_middles_of_equal_parts() -> None:
    """Each sample from the one before: the same as the law of the lag at once."""
    lagged = Course.held(2.0).followed_by(ActuatorLag(time_constant=0.003), 0.5, 0.005, straight=False)
    instants = 0.005 * (np.arange(12) + 0.5) / 12
    assert [float(value) for value in lagged.path] == pytest.approx(2.0 - 1.5 * np.exp(-instants / 0.003), rel=1e-14)


@pytest.mark.parametrize("rate", [20.0, 200.0])
def test_a_ramp_with_a_lag_behind_it_bends_where_the_ramp_ends(rate: float) -> None:
    hidden = {"rate_limit": {"rate": rate}, "actuator_lag": {"time_constant": 0.003}}
    command = excitation(3, duration=4.0)
    out = record(Machine().hiding(**hidden), command, noise=0.0, bits=None)
    model = ServoModel.paper().with_effect(RateLimit(rate=rate)).with_effect(ActuatorLag(time_constant=0.003))
    assert np.abs(simulate(model, command=command, dt=0.005)[:-1, 0] - out.angle[:, 0]).max() < 5e-5
