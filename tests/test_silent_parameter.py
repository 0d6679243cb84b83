"""A parameter without information, as an instant between two samples has none, does not hold up the others."""

from __future__ import annotations

import numpy as np
import pytest
from machine import Machine, excitation, record

from identification.problem import Problem
from plant import ServoModel
from plant.effects import DeadZone, InputDelay, PayloadChange, StribeckFriction


def test_a_delay_is_found_beside_an_instant_that_has_no_slope() -> None:
    """Rounding had sent the instant off by 10^135, every step was refused, and the delay stayed where it began."""
    payload = {"time": 23.1416, "inertia": 0.2, "gravity": 0.06}
    friction = {"coulomb": 0.4, "excess": 0.4, "velocity": 0.3}
    hidden = Machine().hiding(input_delay={"time": 0.005}, stribeck_friction=friction, payload_change=payload)
    log = record(hidden, excitation(26000, duration=30.0), seed=13000).log()
    model = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8)
    effects = (
        DeadZone(half_width=0.5),
        InputDelay(time=0.0044),
        StribeckFriction(**friction),
        PayloadChange(**payload),
    )
    for effect in effects:
        model = model.with_effect(effect)
    problem = Problem.of(log, model)
    start = problem.pack(model.values, np.zeros((1, 2)))
    instant = [model.names[place] for place in problem.free].index("payload_change.time")
    assert problem.linearise(start, 0.0, 0.0).information[instant, instant] == 0.0
    values, _ = problem.unpack(problem.minimise(start, 0.0, 0.0).point)
    found = dict(zip(model.names, values, strict=True))
    assert found["input_delay.time"] == pytest.approx(0.005, abs=2e-5)
    assert found["payload_change.time"] == 23.1416
