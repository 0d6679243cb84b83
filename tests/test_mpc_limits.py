"""Torque rates and soft limits of a controller: kept in the loop, and reported when they cannot be kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from four_hertz import four_hertz
from numpy.typing import NDArray

from mpc import Control, Controller, closed_loop
from plant import GearTrain, Rig, ServoModel, machine_code, sample_step
from plant.effects import ActuatorLag, CoulombFriction, Effect, InputDelay
from plant.errors import BadParameter

Array = NDArray[np.float64]
PAPER = GearTrain.paper()
RIGID = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=0.8)
FORMS = [False] if machine_code.compiler() is None else [False, True]  # compiled
SIGMA = float(np.sqrt((2 * np.pi / 2**17) ** 2 / 12 + 2e-5**2))  # of the sensor, by default [rad]


def of_form(compiled: bool, model: ServoModel = RIGID, **options: object) -> Controller:
    controller = four_hertz(model, PAPER, **options)  # type: ignore[arg-type]
    if not compiled:
        controller._step = controller._interpreted
    return controller


def follow(
    controller: Controller,
    reference: Callable[[Array], Array],
    count: int = 400,
    start: tuple[float, float] = (0.0, 0.0),
) -> tuple[Array, list[Control]]:
    """States (count, 2) and controls of a servo that equals its rigid model, with an exact measurement of the angle."""
    step, state, last = sample_step(RIGID, substeps=4), np.array(start), 0.0
    states, controls = [], []
    for k in range(count):
        control = controller.step(
            float(state[0]), reference(0.005 * np.arange(k, k + controller.horizon + 1, dtype=np.float64))
        )
        states.append(state)
        controls.append(control)
        torque = float(PAPER.output_torque(control.torques))
        inputs = np.array([torque, last, 0.0, np.inf, 0.0, 0.005, 0.0, 0.0])
        state, last = np.asarray(step(state, inputs, RIGID.values))[:, 0], torque
    return np.array(states), controls


def jump(time: Array) -> Array:
    return np.full(time.size, 0.5)


def test_the_whole_plan_keeps_the_torque_rate() -> None:
    last, used = 0.0, 0
    for control in follow(four_hertz(RIGID, PAPER, torque_rate=20.0), jump)[1]:
        planned = PAPER.output_torque(control.predicted_torques)
        steps = np.abs(np.diff(np.append(last, planned)))
        assert np.max(steps) < 0.1 + 1e-6
        used += int(np.sum(steps[1:] > 0.0999))
        last = planned[0]
        assert control.status in ("optimal", "degraded: the load does not follow the reference")  # by the rate limit
    assert used > 100  # the rate limit is also active between later samples


def test_the_plan_lets_the_preload_fall_no_faster_than_it_may() -> None:
    steepest = 0.0
    for control in follow(four_hertz(RIGID, PAPER, preload_rate=0.2), jump, 150)[1]:
        preload = (control.predicted_torques[:, 0] - control.predicted_torques[:, 1]) / 2
        steepest = max(steepest, float(np.max(-np.diff(preload))))
    assert steepest == pytest.approx(0.2 * 0.005, rel=1e-6)


@pytest.mark.parametrize("compiled", FORMS)
@pytest.mark.parametrize("reference", [jump, lambda time: 0.6 * time], ids=["jump", "ramp"])
def test_a_reference_beyond_the_limit_stops_at_the_limit(reference: Callable[[Array], Array], compiled: bool) -> None:
    controller = of_form(compiled, angle_limits=(-1.0, 0.3))
    states, controls = follow(controller, reference)
    assert np.max(states[:, 0]) < 0.3 + SIGMA
    assert states[-1, 0] == pytest.approx(0.3, abs=1e-7)
    assert {control.status for control in controls} == {"optimal"}
    assert max(float(np.max(control.predicted_angle)) for control in controls) < 0.3 + SIGMA
    assert np.max(follow(four_hertz(RIGID, PAPER), reference)[0][:, 0]) > 0.45


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_big_step_keeps_the_speed_limit(direction: float) -> None:
    states, controls = follow(four_hertz(RIGID, PAPER, speed_limit=0.3), lambda time: direction * jump(time), 600)
    assert np.max(np.abs(states[:, 1])) < 0.3 + 1e-6
    assert np.sum(np.abs(states[:, 1]) > 0.2999) > 100  # and reaches the limit
    assert states[-1, 0] == pytest.approx(direction * 0.5, abs=1e-3)
    assert {control.status for control in controls} == {"optimal"}
    assert np.max(np.abs(follow(four_hertz(RIGID, PAPER), jump)[0][:, 1])) > 0.5


def test_from_beyond_the_limit_it_returns_smoothly_and_reports() -> None:
    controller = four_hertz(RIGID, PAPER, angle_limits=(-1.0, 0.3))
    states, controls = follow(controller, lambda time: np.full(time.size, 0.2), start=(0.5, 0.0))
    back = int(np.argmax(states[:, 0] < 0.3))
    assert 0 < back < 200
    assert np.all(np.diff(states[3:back, 0]) < 0)  # it returns at once, without reversing
    assert states[-1, 0] == pytest.approx(0.2, abs=1e-3)
    assert np.min(states[:, 0]) > 0.18
    assert controls[0].status == "degraded: a limit of angle or speed cannot be kept"
    assert controls[-1].status == "optimal"
    assert all(control.residual <= 1e-6 for control in controls)


def test_noise_beyond_a_limit_does_not_shake_the_torques() -> None:
    level, greatest = replace(RIGID, gravity=0.0), []
    for limits in ((-9.0, 9.0), (-1.0, 0.3)):
        controller = four_hertz(level, PAPER, angle_limits=limits)
        _, controls = follow(controller, lambda time: np.full(time.size, 0.3), 100, start=(0.3 + 6 * SIGMA, 0.0))
        greatest.append(max(abs(float(PAPER.output_torque(control.torques))) for control in controls))
    assert greatest[1] < 1.2 * greatest[0] < 0.5 * 2.254  # and far below the greatest torque


def test_from_beyond_the_speed_limit_it_slows_down() -> None:
    states, controls = follow(four_hertz(RIGID, PAPER, speed_limit=0.3), jump, 600, start=(0.0, 0.8))
    slow = int(np.argmax(states[:, 1] < 0.301))
    assert np.all(np.diff(states[5:slow, 1]) < 0)
    assert slow < 150
    assert np.max(states[slow:, 1]) < 0.302
    assert "limit" in controls[10].status
    assert controls[-1].status == "optimal"


def test_limits_never_cost_the_bounds_of_the_torques() -> None:
    tight = four_hertz(RIGID, PAPER, angle_limits=(-0.01, 0.01), speed_limit=0.05, torque_rate=50.0, rotor_inertia=1e-5)
    states, controls = follow(tight, jump, 300, start=(0.4, 1.5))
    for control in controls:
        assert np.all((control.predicted_torques * [1, -1] >= 0.02) & (control.predicted_torques * [1, -1] <= 0.3))
    assert np.max(states[:, 0]) > 0.5  # the limits cannot be kept at first
    assert min(control.margin for control in controls) > -1e-9
    assert abs(states[-1, 1]) < 0.5 < np.max(states[:, 1])


@pytest.mark.parametrize(
    "effect", [InputDelay(time=0.012), ActuatorLag(time_constant=0.02), CoulombFriction(torque=0.2)], ids=str
)
@pytest.mark.parametrize(
    "limits", [{"angle_limits": (-0.02, 0.02)}, {"speed_limit": 0.1}, {"torque_rate": 2.0}], ids=str
)
def test_both_forms_go_the_same_way(effect: Effect, limits: dict[str, object]) -> None:
    pair = [of_form(compiled, RIGID.with_effect(effect), horizon=12, sqp_iterations=2, **limits) for compiled in FORMS]
    angle, rng, active = 0.0, np.random.default_rng(0), 0
    for k in range(120):
        reference = 0.15 * np.sin(0.1 * (k + np.arange(13))) if k % 3 else 0.15
        one, other = (controller.step(angle, reference) for controller in (pair[0], pair[-1]))
        assert np.array_equal(one.predicted_torques, other.predicted_torques), k
        assert (one.status, one.residual) == (other.status, other.residual)
        active += bool(np.any(pair[0]._arrays["forces"]))
        angle = one.predicted_angle[1] + 1e-4 * rng.normal()
    assert active > 0


def test_on_the_rig_the_limit_holds_and_the_contact_is_kept() -> None:
    controller = four_hertz(RIGID, PAPER, angle_limits=(-0.2, 0.2), min_torque=0.03)
    loop = closed_loop(controller, Rig.paper_like(), lambda t: 0.3 * np.sin(2 * np.pi * 0.3 * t), 3.5, seed=0)
    assert np.max(np.abs(loop.angle)) < 0.2 + 5 * SIGMA
    assert np.ptp(loop.angle) > 0.395
    assert loop.minimum_contact_torque > 0.0


@pytest.mark.parametrize(
    "bad",
    [
        {"angle_limits": (0.3, 0.3)},
        {"angle_limits": (0.3, float("nan"))},
        {"angle_limits": (0.1, 0.2, 0.3)},
        {"speed_limit": 0.0},
        {"speed_limit": float("nan")},
    ],
)
def test_refuses_limits_that_cannot_be(bad: dict[str, object]) -> None:
    with pytest.raises(BadParameter, match="limit"):
        four_hertz(RIGID, PAPER, **bad)  # type: ignore[arg-type]
