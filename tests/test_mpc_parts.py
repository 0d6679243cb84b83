"""The parts of the controller: prediction, estimator, governor, preview, inverse of the drive."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from random_quadratic_programs import responses
from scipy.linalg import solve_discrete_are

from mpc.drive import DriveInverse
from mpc.estimator import Estimator
from mpc.friction import Frictionless
from mpc.governor import Governor
from mpc.prediction import Predictor
from mpc.preview import prolonged
from mpc.soft_limits import SoftLimits
from plant import ServoModel, simulate
from plant.effects import (
    ActuatorLag,
    BackEmf,
    Cogging,
    CoulombFriction,
    DeadZone,
    EncoderEccentricity,
    InputDelay,
    SensorLag,
    StribeckFriction,
    TorqueSaturation,
)
from plant.errors import BadParameter

Array = NDArray[np.float64]

DT = 0.005
RICH = ServoModel.paper().without_effect("dead_zone").with_effect(ActuatorLag(time_constant=0.02))
RICH = RICH.with_effect(Cogging(amplitude=0.2, order=12.0, phase=0.3))
RICH = RICH.with_effect(StribeckFriction(coulomb=0.3, excess=0.1, velocity=0.1))
RICH = RICH.with_effect(InputDelay(time=0.002))
SMOOTH = Frictionless.of(RICH)


def predictor(model: ServoModel = SMOOTH) -> Predictor:
    return Predictor(model=model, sample_time=DT, switch=float(model.delay()))


# Prediction.


def test_the_prediction_is_the_plants_simulation() -> None:
    commands = np.sin(np.arange(40.0))
    ahead = predictor().look_ahead(np.zeros(3), np.append(commands[0], commands), 0.0)
    expected = simulate(SMOOTH, command=commands, dt=DT, state=np.zeros(3))
    assert ahead.states == pytest.approx(expected, abs=1e-10)  # the lag is integrated exactly in one step


@pytest.mark.parametrize("lag", [2e-4, 1e-3, 2.4e-3, 2.5e-3, 5e-3, 2e-2])
def test_an_actuator_is_predicted_within_a_fiftieth(lag: float) -> None:
    model = ServoModel(inertia=2.0).with_effect(ActuatorLag(time_constant=lag))
    for command in (1.0, -1.0):
        ahead = predictor(model).look_ahead(np.zeros(3), np.array([0.0, command]), 0.0).states[1]
        expected = simulate(model, command=np.array([command]), dt=DT, state=np.zeros(3), substeps=50)[1]
        assert ahead[0] == pytest.approx(expected[0], abs=DT**2 / (2 * model.inertia) / 50)
        assert ahead[1] == pytest.approx(expected[1], abs=DT / model.inertia / 1000)


def test_the_disturbance_is_a_torque_beside_the_command() -> None:
    commands = np.sin(np.arange(40.0))
    start = np.array([0.1, 0.2, 0.3])
    with_disturbance = predictor().look_ahead(start, commands, 0.7)
    added = predictor().look_ahead(start, commands + 0.7, 0.0)
    assert np.array_equal(with_disturbance.states, added.states)


@pytest.mark.parametrize("seed", range(5))
def test_the_responses_are_the_derivatives(seed: int) -> None:
    rng = np.random.default_rng(seed)
    state, torques = rng.normal(size=3) * 0.3, rng.normal(size=13)
    late = 2
    ahead = predictor().look_ahead(state, torques, 0.1)
    S = responses(ahead.state_jacobians[late:], ahead.torque_jacobians[late:])
    for j in range(10):
        change = np.zeros(13)
        change[1 + late + j] = 1e-6
        up = predictor().look_ahead(state, torques + change, 0.1).states
        down = predictor().look_ahead(state, torques - change, 0.1).states
        assert S[:, :, j] == pytest.approx((up - down)[late + 1 :] / 2e-6, rel=1e-4, abs=1e-8)


# The estimator.


def estimator(model: ServoModel) -> Estimator:
    return Estimator(
        predictor=predictor(model),
        resolution=2 * np.pi / 2**17,
        noise=2e-5,
        torque_noise=0.05,
        disturbance_rate=1.0,
    )


def test_on_a_linear_servo_it_is_the_stationary_kalman_filter() -> None:
    J, K = 2.0, 0.8
    filter_ = estimator(ServoModel(inertia=J, gravity=0.0, viscous_friction=K))
    filter_.start(0.0, 0.0)
    for _ in range(1500):
        filter_.advance(0.0, 0.0, 0.0)
    decay = np.exp(-K * DT / J)
    slide = (1 - decay) * J / K
    F = np.array([[1, slide, (DT - slide) / K], [0, decay, (1 - decay) / K], [0, 0, 1.0]])
    kick = DT / J * 0.05
    Q = np.diag([(kick * DT / 2) ** 2, kick**2, DT])
    R = (2 * np.pi / 2**17) ** 2 / 12 + 4e-10
    before = solve_discrete_are(F.T, np.array([[1.0], [0], [0]]), Q, np.array([[R]]))
    gain = before[:, 0] / (before[0, 0] + R)
    step = 1e-5
    filter_.advance(step, 0.0, 0.0)
    assert filter_.state is not None
    assert filter_.state / step == pytest.approx(gain[:2], rel=1e-4)
    assert filter_.disturbance / step == pytest.approx(gain[2], rel=1e-4)


def test_it_finds_a_torque_that_the_model_does_not_have() -> None:
    model = ServoModel.paper().without_effect("dead_zone").with_effect(CoulombFriction(torque=0.2))
    commands = 1.5 * np.sin(2 * np.pi * np.arange(800) * DT)
    truth = simulate(model, command=commands + 0.4, dt=DT)
    filter_ = estimator(model)
    rng = np.random.default_rng(0)
    for k in range(800):
        reading = truth[k, 0] + 2e-5 * rng.standard_normal()
        filter_.advance(reading, commands[max(k - 1, 0)], commands[max(k - 2, 0)])
    assert filter_.state is not None
    assert filter_.disturbance == pytest.approx(0.4, abs=0.08)
    assert filter_.state == pytest.approx(truth[799], abs=5e-3)


def test_one_outlier_is_ignored_and_a_lasting_change_is_followed() -> None:
    filter_ = estimator(ServoModel(inertia=2.0, gravity=0.0, viscous_friction=0.8))
    for _ in range(50):
        assert filter_.advance(0.1, 0.0, 0.0) == ""
    assert "jumped" in filter_.advance(1.1, 0.0, 0.0)
    assert filter_.state is not None
    assert filter_.state[0] == pytest.approx(0.1, abs=1e-3)
    assert filter_.advance(0.1, 0.0, 0.0) == ""
    estimates = [filter_.advance(1.1, 0.0, 0.0) for _ in range(4)]
    assert "restarted" in estimates[2]
    assert estimates[3] == ""
    assert filter_.state[0] == pytest.approx(1.1, abs=1e-3)


def test_reset_clears_disturbance_and_actuator_state() -> None:
    filter_ = estimator(ServoModel(gravity=0.0).with_effect(ActuatorLag(time_constant=0.02)))
    filter_.disturbance = 0.7
    filter_.start(0.1, 1.5)
    assert filter_.disturbance == 0.0
    assert filter_.state == pytest.approx([0.1, 0.0, 1.5])
    filter_.state = np.array([0.1, np.inf, 0.0])
    with np.errstate(all="ignore"):
        assert filter_.advance(0.2, 0.5, 0.5) == "the estimate diverged and restarted"
    assert filter_.state == pytest.approx([0.2, 0.0, 0.5])


@pytest.mark.parametrize("lag", [None, SensorLag(time_constant=0.02)])
def test_it_starts_at_the_angle_that_the_sensor_shows(lag: SensorLag | None) -> None:
    model = ServoModel(gravity=0.0).with_effect(EncoderEccentricity(amplitude=0.05, order=3.0, phase=0.4))
    model = model if lag is None else model.with_effect(lag)
    true = 0.3
    reading = true + 0.05 * np.sin(3.0 * true + 0.4)
    filter_ = estimator(model)
    for _ in range(5):
        assert filter_.advance(reading, 0.0, 0.0) == ""
    assert filter_.state is not None
    assert filter_.state[0] == pytest.approx(true, abs=1e-9)


def test_it_needs_a_sensor_with_some_error() -> None:
    with pytest.raises(BadParameter):
        Estimator(predictor=predictor(), resolution=0.0, noise=0.0, torque_noise=0.1, disturbance_rate=1.0)


# The governor.

limits = st.floats(0.5, 10.0)


@settings(max_examples=30, deadline=None)
@given(
    st.floats(-3, 3),
    st.floats(-3, 3),
    st.floats(-2, 2),
    limits,
    limits,
)
def test_it_arrives_exactly_within_its_acceleration(
    goal: float, angle: float, rate: float, backward: float, forward: float
) -> None:
    governor = Governor(sample_time=DT)
    governor.restart(angle, rate)
    weaker = min(backward, forward)
    longest = 2 * (abs(rate) / weaker + np.sqrt((abs(goal - angle) + rate**2 / weaker) / weaker)) + 0.2
    path = [governor.govern(np.full(2, goal), (backward, forward)) for _ in range(int(longest / DT))]
    now = np.array([p[0] for p in path])
    accelerations = np.diff(now, 2) / DT**2
    assert np.all(accelerations <= forward + 1e-6)
    assert np.all(accelerations >= -backward - 1e-6)
    assert now[-1] == pytest.approx(goal, abs=1e-9)


def test_it_brakes_with_all_that_the_braking_sense_has() -> None:
    # initial speed backward: 1 s to brake, then 1 rad back, braked with the weak limit: 4.6 s in minimum time
    governor = Governor(sample_time=DT)
    governor.restart(0.0, -2.0)
    path = np.array([governor.govern(np.zeros(2), (0.1, 2.0))[0] for _ in range(1180)])
    assert np.min(path) == pytest.approx(-1.0, abs=0.02)
    assert np.max(path) < 1e-6
    assert path[-1] == pytest.approx(0.0, abs=1e-9)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), limits, limits)
def test_it_never_asks_for_more_than_its_acceleration(seed: int, backward: float, forward: float) -> None:
    # a reference with accelerations above the limits in both directions leaves no reserve for corrections
    governor = Governor(sample_time=DT)
    turns = 3.0 * np.random.default_rng(seed).choice([-backward, 0.0, forward], 200)
    path = governor.govern(np.cumsum(np.cumsum(turns)) * DT**2, (backward, forward))
    accelerations = np.diff(path, 2) / DT**2
    assert np.all((accelerations >= -backward - 1e-6) & (accelerations <= forward + 1e-6))


def test_what_can_be_followed_is_followed_exactly() -> None:
    time = np.arange(1000) * DT
    wanted = 0.2 * (1 - np.cos(2 * np.pi * 0.25 * time))
    governor = Governor(sample_time=DT)
    governor.restart(wanted[0], (wanted[1] - wanted[0]) / DT)
    for k in range(900):
        assert governor.govern(wanted[k : k + 31], (1.0, 1.0)) == pytest.approx(wanted[k : k + 31], abs=1e-12)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), limits, limits, st.floats(0.05, 1.0), st.floats(0.05, 2.0))
def test_it_brakes_before_a_limit_whatever_is_wanted(
    seed: int, backward: float, forward: float, high: float, speed: float
) -> None:
    soft = SoftLimits(angle=(-0.3, high), speed=speed).numbers(25.0, DT, 2e-5)
    governor, rng = Governor(sample_time=DT, soft=soft), np.random.default_rng(seed)
    governor.restart(0.0, 0.0)
    wanted = np.repeat(rng.normal(size=5), 60) + 0.5 * np.sin(rng.uniform(1, 20) * DT * np.arange(300))
    path = governor.govern(wanted, (backward, forward))
    assert np.all((path <= high + 1e-12) & (path >= -0.3 - 1e-12))
    assert np.all(np.abs(np.diff(path)) <= speed * DT + 1e-12)
    accelerations = np.diff(path, 2) / DT**2
    assert np.all((accelerations >= -backward - 1e-6) & (accelerations <= forward + 1e-6))


def test_from_beyond_a_limit_the_reference_comes_back_to_it() -> None:
    soft = SoftLimits(angle=(-0.3, 0.2), speed=0.5).numbers(25.0, DT, 2e-5)
    governor = Governor(sample_time=DT, soft=soft)
    governor.restart(0.6, 1.0)
    path = np.array([governor.govern(np.full(2, 0.9), (2.0, 2.0))[0] for _ in range(1000)])
    assert np.max(path) == pytest.approx(0.6 + 1.0**2 / (2 * 2.0), abs=0.01)  # it brakes at once
    assert path[-1] == pytest.approx(0.2, abs=1e-9)
    assert np.min(path) > 0.2 - 1e-9
    assert np.max(-np.diff(path)) / DT == pytest.approx(0.5, abs=1e-9)


# Extrapolation of the reference.


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1), st.integers(0, 30))
def test_a_prolonged_path_keeps_its_acceleration(level: float, speed: float, acceleration: float, count: int) -> None:
    k = np.arange(5 + count)
    parabola = level + speed * k + acceleration * k**2
    path = np.array(prolonged(ca.DM(parabola[:5]), count))[:, 0]
    assert path == pytest.approx(parabola, abs=1e-10 * (1 + count**2))


# The inverse of the drive.

quantity = st.floats(0, 2)


@given(quantity, quantity, st.floats(1, 10), st.floats(-5, 5), st.floats(-3, 3))
def test_what_is_commanded_comes_out(
    half_width: float, back_emf: float, limit: float, torque: float, velocity: float
) -> None:
    inverse = DriveInverse(half_width=half_width, back_emf=back_emf, limit=limit)
    least, greatest = inverse.effective(np.array([-1e3, 1e3]), velocity)
    torque = float(np.clip(torque, least, greatest))
    out = inverse.effective(inverse.command(torque, velocity), velocity)
    assert abs(float(out) - torque) <= max(0.1 * half_width if abs(torque) < 0.1 * half_width else 0.0, 1e-12)


def test_the_drive_is_the_plants_actuator() -> None:
    effects = (DeadZone(half_width=0.4), BackEmf(constant=0.3), TorqueSaturation(limit=2.0))
    inverse, behind = DriveInverse.of(RICH.with_effect(effects[0]).with_effect(effects[1]).with_effect(effects[2]))
    assert behind == RICH
    for torque, velocity in ((0.5, 0.0), (5.0, 1.0), (-5.0, 1.0), (1.0, 2.0), (-0.5, -0.7)):
        out = torque
        for effect in replace(RICH, effects=effects).effects:  # in the order of the catalogue
            out = float(effect.command(out, 0.0, velocity))
        assert float(inverse.effective(torque, velocity)) == pytest.approx(out)
