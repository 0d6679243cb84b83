"""Closed loop on the test bench, which the model only approximates."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from four_hertz import four_hertz
from numpy.typing import NDArray

from mpc import ClosedLoopResult, Controller, closed_loop
from plant import ServoModel, sample_step
from plant.effects import ActuatorLag, Cogging, CoulombFriction, InputDelay
from plant.errors import BadParameter
from plant.gears import GearTrain
from plant.rig import Rig

Array = NDArray[np.float64]

PAPER = GearTrain.paper()
RIG = Rig.paper_like()
RIGID = ServoModel(inertia=RIG.total_inertia, gravity=0.5, viscous_friction=0.8)
COUNT = 2 * np.pi / RIG.encoder_counts


def swing(time: Array) -> Array:
    """Oscillation within 0.4 rad at 0.25 Hz [rad]."""
    return 0.2 * (1 - np.cos(2 * np.pi * 0.25 * time))


def run(model: ServoModel, rig: Rig = RIG, duration: float = 3.0, min_torque: float = 0.02) -> ClosedLoopResult:
    return closed_loop(four_hertz(model, PAPER, min_torque=min_torque), rig, swing, duration, seed=0)


def test_it_tracks_and_keeps_the_contact() -> None:
    result = run(RIGID)
    assert result.tracking_rms < 3 * COUNT
    assert result.degraded == 0
    assert result.minimum_contact_torque > 0.0
    assert np.all(result.torques[:, 0] >= 0.02)
    assert np.all(result.torques[:, 1] <= -0.02)
    assert np.all(np.abs(result.torques) <= 0.3)


def test_without_preload_they_part() -> None:
    assert run(RIGID, min_torque=0.0).minimum_contact_torque <= 0.0


@pytest.mark.parametrize("load", [0.4, -0.5])
def test_a_constant_load_leaves_no_error(load: float) -> None:
    pushes = np.where(np.arange(600) > 200, load, 0.0)
    result = closed_loop(four_hertz(RIGID, PAPER), RIG, 0.3, 3.0, seed=1, disturbance=pushes)
    error = result.angle - 0.3
    assert np.max(np.abs(error[200:300])) > 2 * COUNT
    assert abs(np.mean(error[-200:])) < 0.25 * COUNT  # due to noise: 0.06 to 0.25 of a count over six seeds
    assert np.mean(result.disturbance[-200:]) == pytest.approx(load, abs=0.05)


@pytest.mark.parametrize(
    ("rig", "effect", "gain"),
    [
        (Rig.paper_like(coulomb_friction=0.4), CoulombFriction(torque=0.5), 0.3),
        (
            Rig.paper_like(cogging_amplitude=0.3, cogging_order=40.0),
            Cogging(amplitude=0.3, order=40.0, phase=0.0),
            0.5,
        ),
    ],
)
def test_a_model_that_knows_the_effect_tracks_better(rig: Rig, effect: CoulombFriction | Cogging, gain: float) -> None:
    # without the first quarter second, in which both models learn gravity
    def settled(result: ClosedLoopResult) -> float:
        return float(np.sqrt(np.mean((result.angle - result.reference)[50:] ** 2)))

    assert settled(run(RIGID.with_effect(effect), rig)) < gain * settled(run(RIGID, rig))


@pytest.mark.parametrize("seed", [0, 5])
def test_a_reference_jump_keeps_contact_without_overshoot(seed: int) -> None:
    result = closed_loop(Controller(RIGID, PAPER), RIG, lambda t: 0.5 * (t > 0.2), 3.0, seed=seed)
    assert np.max(result.angle) < 0.515
    assert abs(result.angle[-1] - 0.5) < 2 * COUNT
    assert result.minimum_contact_torque > 0.0


def test_a_reference_jump_is_followed_with_little_margin_too() -> None:
    result = closed_loop(four_hertz(RIGID, PAPER), RIG, lambda t: 0.5 * (t > 0.2), 3.0, seed=0)
    assert np.max(result.angle) < 0.512
    assert abs(result.angle[-1] - 0.5) < 2 * COUNT


def test_a_reference_out_of_reach_is_approached_without_cycling() -> None:
    result = closed_loop(four_hertz(RIGID, PAPER), RIG, lambda t: 0.4 * np.sin(2 * np.pi * 0.25 * t), 3.0, seed=0)
    assert np.max(np.abs(result.angle)) < 0.5
    assert result.minimum_contact_torque > 0.0


def exact_servo(plant: ServoModel) -> Callable[[Array, Array], Array]:
    """One sample of a servo with the exact equations of `plant`: its next state from pinion torques."""
    step = sample_step(plant, substeps=4)
    whole, switch = divmod(float(plant.delay()), 0.005)
    values = plant.values
    if "input_delay.time" in plant.names:
        values[plant.names.index("input_delay.time")] = switch
    commands = deque([0.0] * (int(whole) + 2), maxlen=int(whole) + 2)

    def advance(state: Array, torques: Array) -> Array:
        commands.append(float(PAPER.output_torque(torques)))
        inputs = np.array([commands[1], commands[0], 0.0, np.inf, 0.0, 0.005, 0.0, 0.0])
        return np.asarray(step(state, inputs, values))[:, 0]

    return advance


def follow(model: ServoModel, plant: ServoModel) -> float:
    """RMS error [rad] after two seconds of a controller on a servo with the exact equations of `plant`."""
    controller = four_hertz(model, PAPER)
    advance, state = exact_servo(plant), np.zeros(len(plant.states))
    errors = []
    wanted = swing(np.arange(831) * 0.005)
    for k in range(800):
        errors.append(state[0] - wanted[k])
        control = controller.step(round(state[0] / COUNT) * COUNT, wanted[k : k + 31])
        state = advance(state, control.torques)
    return float(np.sqrt(np.mean(np.square(errors[400:]))))


@pytest.mark.parametrize(
    "effect", [None, InputDelay(time=0.004), InputDelay(time=0.013), ActuatorLag(time_constant=0.02)], ids=str
)
def test_the_estimate_knows_which_torque_acted_when(effect: InputDelay | ActuatorLag | None) -> None:
    plant = RIGID if effect is None else RIGID.with_effect(effect)
    # a filter with small process noise reveals torques that are off by a sample
    controller = four_hertz(plant, PAPER, torque_noise=1e-3, disturbance_rate=1e-2)
    advance, state = exact_servo(plant), np.zeros(len(plant.states))
    misses = []
    for k in range(200):
        control = controller.step(round(state[0] / COUNT) * COUNT, np.full(31, 0.1 * (k // 40 % 2)))
        assert controller.estimator.state is not None
        misses.append(controller.estimator.state[1] - state[1])
        state = advance(state, control.torques)
    assert np.max(np.abs(misses[20:])) < 1e-3


def test_a_delay_that_is_known_is_compensated() -> None:
    delayed = RIGID.with_effect(InputDelay(time=0.032))
    assert follow(delayed, delayed) < 0.3 * follow(RIGID, delayed)


def test_a_lag_that_is_known_is_compensated() -> None:
    lagging = RIGID.with_effect(ActuatorLag(time_constant=0.03))
    assert follow(lagging, lagging) < 0.3 * follow(RIGID, lagging)


def test_a_dead_zone_that_is_known_is_compensated() -> None:
    paper = ServoModel.paper()
    assert follow(paper, paper) < 0.5 * follow(paper.without_effect("dead_zone"), paper)


def test_the_torque_changes_no_faster_than_it_may() -> None:
    advance, state = exact_servo(RIGID), np.zeros(2)
    bounded = four_hertz(RIGID, PAPER, torque_rate=20.0)
    torques, worst = [], 0.0
    for k in range(600):
        control = bounded.step(state[0], np.full(31, 0.2 * (k > 50)))
        assert control.status in ("optimal", "degraded: the load does not follow the reference")  # by the rate limit
        torques.append(float(PAPER.output_torque(control.torques)))
        if k:
            ahead = PAPER.output_torque(control.predicted_torques) - torques[-2]
            worst = max(worst, float(np.max(np.abs(ahead) - 0.1 * np.arange(1, 31))))
        state = advance(state, control.torques)
    steps = np.abs(np.diff(torques))
    assert np.max(steps) == pytest.approx(0.1, abs=1e-9)
    assert np.sum(steps > 0.0999) > 10
    assert worst < 1e-9
    assert state[0] == pytest.approx(0.2, abs=1e-4)


def test_preload_falls_at_its_rate_and_rises_with_the_torque() -> None:
    advance, state = exact_servo(RIGID), np.zeros(2)
    slow, least = four_hertz(RIGID, PAPER, preload_rate=0.2), four_hertz(RIGID, PAPER)
    preloads, lowest = [], []
    for k in range(400):
        reference = np.full(31, 0.2 * (k > 50))
        control, other = slow.step(state[0], reference), least.step(state[0], reference)
        preloads.append((control.torques[0] - control.torques[1]) / 2)
        lowest.append((other.torques[0] - other.torques[1]) / 2)
        assert PAPER.output_torque(control.torques) == pytest.approx(PAPER.output_torque(other.torques), abs=1e-9)
        assert np.all(control.torques * [1, -1] >= 0.02)
        assert control.margin >= -1e-12
        state = advance(state, control.torques)
    fall = -np.diff(preloads)
    assert np.max(fall) == pytest.approx(0.2 * 0.005, rel=1e-6)
    assert np.max(-np.diff(lowest)) > 0.01
    assert np.max(-fall) > 0.01
    assert np.all(np.array(preloads) >= np.array(lowest) - 1e-12)


def test_results_add_up() -> None:
    result = run(RIGID, duration=0.5)
    assert result.time.shape == result.angle.shape == (100,)
    assert result.torques.shape == result.contact_torques.shape == (100, 2)
    assert len(result.status) == 100
    assert result.reference == pytest.approx(swing(result.time))
    assert result.copper_loss == pytest.approx(np.mean(result.torques[:, 0] ** 2 + result.torques[:, 1] ** 2))
    samples = closed_loop(four_hertz(RIGID, PAPER), RIG, swing(np.arange(140) * 0.005), 0.5, seed=0)
    assert np.array_equal(samples.angle, result.angle)
    assert result.tracking_rms == pytest.approx(np.sqrt(np.mean((result.angle - result.reference) ** 2)), rel=1e-12)
    assert result.degraded == 0
    assert replace(result, status=("optimal",) * 97 + ("degraded: a", "degraded: b", "optimal")).degraded == 2


@pytest.mark.parametrize(("reference", "duration"), [(0.0, 0.0), (float("nan"), 1.0), (0.0, float("nan"))])
def test_refuses_what_cannot_be_run(reference: float, duration: float) -> None:
    with pytest.raises(BadParameter):
        closed_loop(four_hertz(RIGID, PAPER), RIG, reference, duration, seed=0)
