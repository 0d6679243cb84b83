"""Arbitrary faults: the controller keeps its bounds to the last bit, reports the fault, and recovers. The benchmark
benchmarks/mpc_never_lost.py runs 125,000 such samples."""

from __future__ import annotations

from itertools import islice
from typing import Any

import numpy as np
import pytest
from fault_injection import GEARS, MISHAPS, PATIENCE, broken_promises, life
from four_hertz import four_hertz

from mpc import Controller
from plant import ServoModel, machine_code
from plant.effects import ActuatorLag, InputDelay, StribeckFriction

FORMS = [False] if machine_code.compiler() is None else [True, False]
LIMITS = {"angle_limits": (-0.5, 0.5), "speed_limit": 1.0, "torque_rate": 100.0, "motor_friction": 1e-3}
LATE = ServoModel().with_effect(InputDelay(time=0.012))
RUBS = LATE.with_effect(StribeckFriction(coulomb=0.3, excess=0.2, velocity=0.05))
SLOW = ServoModel().with_effect(InputDelay(time=0.008)).with_effect(ActuatorLag(time_constant=0.01))


@pytest.mark.parametrize(
    ("model", "options", "compiled"),
    [
        (ServoModel.paper(), {}, True),
        (ServoModel(), {"rotor_inertia": 1e-5}, True),
        (LATE, {}, True),
        (ServoModel(), LIMITS, True),
        (SLOW, {**LIMITS, "preload_rate": 1.0, "sqp_iterations": 3}, True),
        (RUBS, {"torque_rate": 40.0, "bandwidth": 2.0}, True),
        (ServoModel.paper(), {}, False),
    ],
    ids=["paper", "heavy rotors", "delay", "limits", "limits, delay and lag", "friction", "without machine code"],
)
def test_it_is_never_lost(model: ServoModel, options: dict[str, Any], compiled: bool) -> None:
    controller = four_hertz(model, GEARS, **options)
    if not compiled:
        controller._step = controller._interpreted
    met = set()
    for sample in islice(life(model, controller, seed=1), 5000 if compiled else 2500):
        met.add(sample.mishap)
        assert broken_promises(controller, sample) == []
        assert sample.calm < PATIENCE
    assert met >= set(MISHAPS) or not compiled


def of_form(compiled: bool, **options: float) -> Controller:
    controller = four_hertz(ServoModel(), GEARS, **options)  # type: ignore[arg-type]
    if not compiled:
        controller._step = controller._interpreted
    return controller


@pytest.mark.parametrize("compiled", FORMS)
def test_a_lost_estimate_does_not_speed_up_the_preload(compiled: bool) -> None:
    controller = of_form(compiled, preload_rate=0.2)
    preloads = []
    for k in range(6):
        if k >= 3:
            controller.estimator.state = None
        torques = controller.step(np.nan if k >= 3 else 0.0, np.full(31, 0.3)).torques
        preloads.append((torques[0] - torques[1]) / 2)
    assert preloads[2] > 0.05
    assert -np.diff(preloads[2:]) == pytest.approx([0.001, 0.001, 0.001], rel=1e-9)


@pytest.mark.parametrize("compiled", FORMS)
def test_numbers_from_before_a_preview_are_forgotten(compiled: bool) -> None:
    controller = of_form(compiled)
    for _ in range(4):
        controller.step(0.1, 0.1)
    controller.step(0.1, np.full(31, 0.1))
    controller.step(0.1, 0.10005)
    assert controller._arrays["wanted"] == pytest.approx(np.full(31, 0.10005), abs=1e-12)


@pytest.mark.parametrize("compiled", FORMS)
def test_a_number_goes_on_at_its_speed_unless_it_jumps(compiled: bool) -> None:
    controller = of_form(compiled)
    for number, speed in ((0.1, 0.0), (0.101, 0.0), (0.102, 0.001), (0.6, 0.0), (0.6, 0.0), (0.6, 0.0)):
        controller.step(0.1, number)
        expected = number + speed * np.arange(31)
        assert controller._arrays["wanted"] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("compiled", FORMS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -1e300, 1e5])
@pytest.mark.parametrize(
    "name",
    ["plan", "path", "history", "load", "bounds", "kalman", "preload", "learnt", "rubs", "past", "following_error"],
)
def test_a_damaged_memory_recovers(name: str, value: float, compiled: bool) -> None:
    controller = of_form(compiled, preload_rate=1.0)
    for _ in range(3):
        controller.step(0.1, np.full(31, 0.1))
    controller._arrays[name][:] = value
    for k in range(25):
        control = controller.step(0.1, np.full(31, 0.1) if k % 2 else 0.1)
        assert np.all(control.predicted_torques * [1, -1] >= 0.02)
        assert np.all(control.predicted_torques * [1, -1] <= 0.3)
        assert np.isfinite(control.margin)
    assert control.status == "optimal"
    assert control.predicted_angle == pytest.approx(np.full(31, 0.1), abs=1e-3)
