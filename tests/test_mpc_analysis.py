"""Linear analysis of the loop, compared with injection in simulation, with python-control, and with closed forms."""

from __future__ import annotations

from collections import deque

import control
import numpy as np
import pytest
from numpy.typing import NDArray

from mpc import Controller, LoopAnalysis, analyse_loop, bode_figure
from mpc.weights import rate_weight, terminal_weight
from plant import GearTrain, ServoModel, sample_step
from plant.effects import ActuatorLag, BackEmf, Effect, InputDelay, SensorLag
from plant.errors import BadParameter

Array = NDArray[np.float64]
PAPER = GearTrain.paper()
RIGID = ServoModel()
ANGLE = 0.3
FREQUENCIES = (1.0, 2.5, 5.0, 10.0, 25.0)


def injected(model: ServoModel, frequency: float) -> complex:
    """S at a frequency [Hz]: response of the torque on the plant to a torque added to that of the controller."""
    controller = Controller(model, PAPER)
    dt = controller.sample_time
    step, whole = sample_step(model, substeps=4), controller._whole_delay
    values = model.values
    if "input_delay.time" in model.names:
        values[model.names.index("input_delay.time")] -= whole * dt
    hold = analyse_loop(controller, angle=ANGLE).torque
    state = np.array([ANGLE, 0.0, *([hold] if "actuator_lag" in model.states else [])])
    state = np.append(state, [ANGLE] * ("sensor_lag" in model.states))
    under_way = deque([hold] * (whole + 2), maxlen=whole + 2)
    count = 400  # whole periods, after the transients
    added, total = np.zeros(2 * count), np.zeros(2 * count)
    for k in range(2 * count):
        control_ = controller.step(float(state[-1] if "sensor_lag" in model.states else state[0]), ANGLE)
        assert control_.status == "optimal"
        added[k] = 0.02 * np.sin(2 * np.pi * frequency * k * dt)
        total[k] = float(PAPER.output_torque(control_.torques)) + added[k]
        under_way.append(total[k])
        inputs = np.array([under_way[1], under_way[0], 0.0, np.inf, 0.0, dt, 0.0, 0.0])
        state = np.asarray(step(state, inputs, values))[:, 0]
    wave = np.exp(-2j * np.pi * frequency * dt * np.arange(count, 2 * count))
    return complex(np.sum((total[count:] - np.mean(total[count:])) * wave) / np.sum(added[count:] * wave))


@pytest.mark.parametrize(
    "effect",
    [
        pytest.param(None, id="rigid", marks=pytest.mark.long),
        pytest.param(InputDelay(time=0.013), id="delay"),
        pytest.param(ActuatorLag(time_constant=0.01), id="lag", marks=pytest.mark.long),
        pytest.param(SensorLag(time_constant=0.005), id="sensor lag"),
    ],
)
def test_the_sensitivity_is_what_injection_shows(effect: Effect | None) -> None:
    model = RIGID if effect is None else RIGID.with_effect(effect)
    loop = analyse_loop(Controller(model, PAPER), angle=ANGLE)
    expected = loop.response(loop.sensitivity, np.array(FREQUENCIES))
    for frequency, S in zip(FREQUENCIES, expected, strict=True):
        assert injected(model, frequency) == pytest.approx(S, rel=0.02), frequency


def loops() -> list[LoopAnalysis]:
    models = (RIGID, RIGID.with_effect(InputDelay(time=0.013)), RIGID.with_effect(BackEmf(constant=0.3)))
    return [analyse_loop(Controller(model, PAPER)) for model in models]


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.filterwarnings("ignore::scipy.signal.BadCoefficients")
def test_the_margins_are_those_of_python_control() -> None:
    for loop in loops():
        gain, phase, _, _, crossover, _ = control.stability_margins(loop.gain)
        assert loop.gain_margin == pytest.approx(gain, rel=1e-2)
        assert loop.phase_margin == pytest.approx(phase, abs=0.1)
        assert loop.crossover == pytest.approx(crossover / (2 * np.pi), rel=1e-3)
        assert np.all(np.abs(loop.sensitivity.poles()) < 1.0)


def test_terminal_cost_equals_the_lqr_cost_of_python_control() -> None:
    J, K, dt, rate = RIGID.inertia, RIGID.viscous_friction, 0.005, rate_weight(RIGID, 4.0, 0.005)
    plant = control.c2d(control.ss([[0, 1], [0, -K / J]], [[0], [1 / J]], np.eye(2), 0), dt)
    A = np.block([[plant.A, plant.B], [np.zeros((1, 2)), np.eye(1)]])  # including the torque of the last sample
    _, cost, _ = control.dlqr(A, A[:, 2:], np.diag([1.0, 0.0, 0.0]), [[rate]])
    free = np.linalg.inv(np.linalg.inv(cost)[:2, :2])  # minimised over the last torque
    assert terminal_weight(RIGID, rate, dt) == pytest.approx(free, rel=1e-6)


def test_margins_are_where_the_loop_becomes_unstable() -> None:
    loop = loops()[0]
    for factor, stable in ((0.99 * loop.gain_margin, True), (1.01 * loop.gain_margin, False)):
        assert (np.max(np.abs(control.feedback(factor * loop.gain, 1).poles())) < 1.0) == stable
    samples = loop.delay_margin / loop.gain.dt
    for count, stable in ((int(samples), True), (int(samples) + 1, False)):
        late = control.tf([1.0], [1.0, *[0.0] * count], loop.gain.dt) if count else 1
        assert (np.max(np.abs(control.feedback(control.ss(loop.gain * late), 1).poles())) < 1.0) == stable


def test_the_numbers_belong_to_the_responses() -> None:
    loop = loops()[0]
    frequencies = np.geomspace(0.1, 99.0, 2000)
    S, T = (loop.response(system, frequencies) for system in (loop.sensitivity, loop.complementary))
    assert pytest.approx(np.ones(2000), abs=1e-8) == S + T
    assert loop.peak_sensitivity == pytest.approx(np.max(np.abs(S)), rel=1e-3)
    assert abs(loop.response(loop.complementary, np.array([loop.bandwidth]))[0]) == pytest.approx(
        np.sqrt(0.5), rel=1e-3
    )
    assert abs(loop.response(loop.gain, np.array([loop.crossover]))[0]) == pytest.approx(1.0, rel=1e-3)
    # the estimated disturbance acts as an integrator: no steady-state error under a constant torque
    assert abs(loop.response(loop.sensitivity, np.array([1e-3]))[0]) < 1e-2


def test_the_plant_is_held_at_the_operating_point() -> None:
    assert analyse_loop(Controller(RIGID, PAPER), angle=1.0).torque == pytest.approx(0.5 * np.cos(1.0), abs=1e-8)
    moving = analyse_loop(Controller(ServoModel(gravity=0.0), PAPER), velocity=0.5)
    assert moving.torque == pytest.approx(0.4, abs=1e-6)


def test_a_faster_loop_has_more_bandwidth_and_less_margin() -> None:
    slow, fast = (analyse_loop(Controller(RIGID, PAPER, bandwidth=bandwidth)) for bandwidth in (2.0, 6.0))
    assert fast.crossover > slow.crossover
    assert fast.delay_margin < slow.delay_margin


def test_the_picture_shows_gain_and_sensitivities() -> None:
    figure = bode_figure(loops()[0])
    upper, lower = figure.axes
    assert {line.get_label() for line in upper.lines} >= {"loop gain L", "sensitivity S", "complementary T"}
    assert "phase margin" in upper.get_title()
    assert "deg" in lower.get_ylabel()


def test_refuses_what_it_leaves_out() -> None:
    with pytest.raises(BadParameter, match="motor_resolution"):
        analyse_loop(Controller(RIGID, PAPER, motor_resolution=1e-3))
    with pytest.raises(BadParameter, match="keeps"):
        analyse_loop(Controller(RIGID, PAPER), angle=float("nan"))
