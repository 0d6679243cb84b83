"""Motor encoders in addition to the load encoder: finer, with unknown offsets, a backup if the load encoder fails."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from mpc import Controller, closed_loop
from mpc.estimator import Estimator, MotorEncoders
from mpc.prediction import Predictor
from plant import GearTrain, Rig, ServoModel, simulate
from plant.effects import Compliance
from plant.errors import BadParameter

Array = NDArray[np.float64]
PAPER = GearTrain.paper()
RATIOS = PAPER.motor_ratios
DT = 0.005
STEP = 2 * np.pi / 4096  # of a motor encoder
COARSE = 2 * np.pi / 2**11  # of the load encoder
RIGID = ServoModel(gravity=0.0)
MOTORS = MotorEncoders(ratios=(float(RATIOS[0]), float(RATIOS[1])), resolution=STEP, noise=2e-6)


def estimator(model: ServoModel = RIGID, motors: MotorEncoders | None = MOTORS) -> Estimator:
    predictor = Predictor(model=model, sample_time=DT, switch=0.0)
    levels = {"resolution": COARSE, "noise": 2e-5, "torque_noise": 0.05, "disturbance_rate": 1.0}
    return Estimator(predictor=predictor, motors=motors, **levels)


def counted(angle: Array, step: float) -> Array:
    return np.asarray(step * np.round(angle / step))


def motion(model: ServoModel = RIGID) -> tuple[Array, Array]:
    """Commands (T,) and states (T + 1, n), with a disturbance torque of 0.5 N m in the second half."""
    commands = 1.5 * np.sin(2 * np.pi * np.arange(800) * DT)
    return commands, simulate(model, command=commands + 0.5 * (np.arange(800) > 400), dt=DT)


def follow(filter_: Estimator, commands: Array, angle: Array, motors: Array) -> Array:
    """(T, n) estimates from load angle (T,) and motor angles (T, 2)."""
    found = []
    for k in range(commands.size):
        torques = commands[max(k - 1, 0)], commands[max(k - 2, 0)]
        filter_.advance(float(angle[k]), *torques, (float(motors[k, 0]), float(motors[k, 1])))
        assert filter_.state is not None
        found.append(filter_.state)
    return np.array(found)


def shown(angle: Array) -> Array:
    """(T, 2) measurements of the motor encoders, with an initial offset."""
    return counted(-RATIOS * (angle[:, None] + [0.3, -0.7]), STEP)


def test_they_show_the_speed_that_a_coarse_encoder_hides() -> None:
    commands, truth = motion()
    angle = counted(truth[:-1, 0], COARSE)
    with_motors = follow(estimator(), commands, angle, shown(truth[:-1, 0]))
    without = follow(estimator(motors=None), commands, angle, np.full((800, 2), np.nan))
    rms = [np.sqrt(np.mean((found[50:, 1] - truth[50:800, 1]) ** 2)) for found in (with_motors, without)]
    assert rms[0] < 0.2 * rms[1]


def test_where_the_load_is_they_learn_from_its_encoder() -> None:
    commands, truth = motion()
    found = follow(estimator(), commands, truth[:-1, 0], shown(truth[:-1, 0]))
    assert found[100:, 0] == pytest.approx(truth[100:800, 0], abs=5e-5)


def test_the_load_is_not_lost_when_its_encoder_fails() -> None:
    commands, truth = motion()
    angle = truth[:-1, 0].copy()
    angle[350:] = np.nan  # before the disturbance torque starts
    found = follow(estimator(), commands, angle, shown(truth[:-1, 0]))
    assert found[:, 0] == pytest.approx(truth[:800, 0], abs=1e-3)
    without_motors = follow(estimator(motors=None), commands, angle, shown(truth[:-1, 0]))
    assert np.max(np.abs(without_motors[:, 0] - truth[:800, 0])) > 0.1


@pytest.mark.parametrize("fault", ["missing", "jumps"])
def test_a_motor_that_shows_nothing_or_jumps_does_no_harm(fault: str) -> None:
    commands, truth = motion()
    motors = shown(truth[:-1, 0])
    if fault == "missing":
        motors[:200, 0], motors[600:, 1] = np.nan, np.inf
    else:
        motors[300:, 0] += 5.0
    found = follow(estimator(), commands, truth[:-1, 0], motors)
    assert found[100:, 0] == pytest.approx(truth[100:800, 0], abs=1e-4)
    assert found[100:, 1] == pytest.approx(truth[100:800, 1], abs=2e-2)


def test_a_motor_that_jumped_is_trusted_again() -> None:
    commands, truth = motion()
    angle, motors = truth[:-1, 0].copy(), shown(truth[:-1, 0])
    motors[200:, 0] += 5.0
    motors[300:, 1], angle[350:] = np.nan, np.nan  # from here on motor 1 is the only measurement
    found = follow(estimator(), commands, angle, motors)
    assert found[:, 0] == pytest.approx(truth[:800, 0], abs=1e-3)


def test_a_motor_before_a_spring_shows_its_own_angle() -> None:
    model = RIGID.with_effect(Compliance(frequency=30.0, damping=0.05, motor_share=0.4))
    commands, truth = motion(model)
    found = follow(estimator(model), commands, truth[:-1, 0], shown(truth[:-1, 2]))
    twist, real = found[:, 2] - found[:, 0], truth[:800, 2] - truth[:800, 0]
    assert np.max(np.abs(real)) > 5e-4
    assert twist[200:] == pytest.approx(real[200:800], abs=1e-4)


def test_the_loop_is_quieter_with_them() -> None:
    rig = replace(Rig.paper_like(), encoder_counts=2**12)
    model = ServoModel(inertia=rig.total_inertia, gravity=0.5, viscous_friction=0.8)
    options = {"encoder_resolution": 2 * np.pi / 2**12}
    runs = [
        closed_loop(Controller(model, PAPER, motor_resolution=step, **options), rig, 0.2, 2.0, seed=0)  # type: ignore[arg-type]
        for step in (None, 2 * np.pi / rig.motor_encoder_counts)
    ]
    quiet = [np.std(np.diff(run.torques[200:, 0])) for run in runs]
    assert quiet[1] < 0.5 * quiet[0]
    assert all(run.degraded == 0 for run in runs)
    assert runs[1].angle[-1] == pytest.approx(0.2, abs=2e-3)


def test_without_their_readings_it_is_as_if_there_were_none() -> None:
    fitted, bare = Controller(RIGID, PAPER, motor_resolution=STEP), Controller(RIGID, PAPER)
    for k in range(40):
        angle = 2e-4 * k**2 / 40
        expected = bare.step(angle, 0.3).predicted_torques
        assert fitted.step(angle, 0.3).predicted_torques == pytest.approx(expected, abs=1e-9)


def test_refuses_angles_that_it_has_no_encoders_for() -> None:
    with pytest.raises(BadParameter, match="motor_resolution"):
        Controller(RIGID, PAPER).step(0.0, 0.0, (0.0, 0.0))
    with pytest.raises(BadParameter, match="two angles"):
        Controller(RIGID, PAPER, motor_resolution=STEP).step(0.0, 0.0, (0.0, 0.0, 0.0))
    for bad in ({"motor_resolution": -1.0}, {"motor_resolution": 0.0, "motor_noise": 0.0}):
        with pytest.raises(BadParameter):
            Controller(RIGID, PAPER, **bad)
