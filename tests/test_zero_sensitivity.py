"""An instant at which the load rests has no slope, or next to none behind an observer, and holds up nothing."""

from __future__ import annotations

import numpy as np
import pytest
from machine import Machine, excitation, record

from identification.log import Log
from identification.problem import Problem
from plant import ServoModel
from plant.effects import DeadZone, InputDelay, PayloadChange, StribeckFriction

PAYLOAD = {"time": 23.1416, "inertia": 0.2, "gravity": 0.06}
FRICTION = {"coulomb": 0.4, "excess": 0.4, "velocity": 0.3}


@pytest.fixture(scope="module")
def log() -> Log:
    """Delay, friction and a payload that comes while the load rests."""
    hidden = Machine().hiding(input_delay={"time": 0.005}, stribeck_friction=FRICTION, payload_change=PAYLOAD)
    return record(hidden, excitation(26000, duration=30.0), seed=13000).log()


@pytest.mark.parametrize(("bandwidth", "error"), [(0.0, 2e-5), (1.0, 2e-5), (5.0, 1e-4)])
def test_a_delay_is_found_beside_an_instant_that_has_no_slope(log: Log, bandwidth: float, error: float) -> None:
    """The instant had been sent off by 10^135 or to the log's end, every step was refused, the delay stayed put."""
    model = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8)
    for effect in (
        DeadZone(half_width=0.5),
        InputDelay(time=0.0044),
        StribeckFriction(**FRICTION),
        PayloadChange(**PAYLOAD),
    ):
        model = model.with_effect(effect)
    problem = Problem.of(log, model)
    start = problem.pack(model.values, np.zeros((1, 2)))
    instant = [model.names[place] for place in problem.free].index("payload_change.time")
    assert problem.linearise(start, bandwidth, 0.0).information[instant, instant] < 1e-12
    values, _ = problem.unpack(problem.minimise(start, bandwidth, 0.0).point)
    found = dict(zip(model.names, values, strict=True))
    assert found["input_delay.time"] == pytest.approx(0.005, abs=error)
    assert found["payload_change.time"] == 23.1416


def test_an_instant_lies_within_the_log(log: Log) -> None:
    """Of one outside it the log says nothing."""
    model = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8).with_effect(PayloadChange(**PAYLOAD))
    problem = Problem.of(log, model)
    instant = [model.names[place] for place in problem.free].index("payload_change.time")
    assert (problem.lower[instant], problem.upper[instant]) == (0.0, pytest.approx(30.0, abs=0.01))
