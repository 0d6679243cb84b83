"""The step as machine code and in Python: both give the same numbers."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from four_hertz import four_hertz
from numpy.typing import NDArray

from allocation import Bounds, least_effort
from mpc import Control, Controller
from mpc.drive import DriveInverse
from mpc.stage_allocation import allocation, machine, reach
from plant import GearTrain, ServoModel, file_cache, machine_code
from plant.effects import (
    ActuatorLag,
    BackEmf,
    Compliance,
    CoulombFriction,
    EncoderEccentricity,
    InputDelay,
    SensorLag,
    TorqueSaturation,
)

Array = NDArray[np.float64]
PAPER = GearTrain.paper()
UNEQUAL = GearTrain(pinion_teeth=(20, 31), output_teeth=161)
RIGID = ServoModel()
with_compiler = pytest.mark.skipif(machine_code.compiler() is None, reason="no C compiler here")
MODELS = {
    "paper": ServoModel.paper(),
    "delays": RIGID.with_effect(InputDelay(time=0.013)).with_effect(CoulombFriction(torque=0.2)),
    "sensor": RIGID.with_effect(EncoderEccentricity(amplitude=0.01, order=3.0, phase=0.1)).with_effect(
        SensorLag(time_constant=0.01)
    ),
    "drive": RIGID.with_effect(BackEmf(constant=0.3)).with_effect(TorqueSaturation(limit=1.5)),
    "lag": RIGID.with_effect(ActuatorLag(time_constant=0.01)),
    "compliance": RIGID.with_effect(Compliance(frequency=40.0, damping=0.1, motor_share=0.3)),
}


def same(one: Control, other: Control) -> bool:
    numbers = (
        (one.predicted_torques, other.predicted_torques),
        (one.predicted_angle, other.predicted_angle),
        ([one.margin, one.disturbance], [other.margin, other.disturbance]),
    )
    return one.status == other.status and all(np.array_equal(a, b, equal_nan=True) for a, b in numbers)


def interpreted(controller: Controller) -> Controller:
    controller._step = controller._interpreted
    return controller


@with_compiler
@pytest.mark.parametrize("gears", [PAPER, UNEQUAL], ids=["paper", "unequal"])
@pytest.mark.parametrize("model", MODELS)
def test_both_forms_hand_out_the_same_torques_to_the_last_bit(model: str, gears: GearTrain) -> None:
    options = {"horizon": 12, "rotor_inertia": 1e-5, "max_torque": 0.2}
    if gears is UNEQUAL:
        options |= {"sqp_iterations": 3, "torque_rate": 20.0, "preload_rate": 0.5, "motor_resolution": 1e-3}
    pair = [four_hertz(MODELS[model], gears, **options) for _ in range(2)]  # type: ignore[arg-type]
    interpreted(pair[1])
    assert [controller.compiled for controller in pair] == [True, False]
    rng = np.random.default_rng(0)
    angle, statuses = 0.0, set()
    for k in range(300):
        reference = 0.3 * rng.normal() if k < 100 or k % 40 < 4 else 0.3 * np.sin(0.05 * (k + np.arange(13)))
        shown = {0: np.nan, 40: np.nan, 90: 5.0, 150: np.inf, 200: angle + 2.0}.get(k, angle)
        if k in (60, 160):
            reference = np.nan * reference
        motors = None if gears is PAPER else [-gears.motor_ratios[0] * angle, np.nan if k % 50 == 7 else 0.1 * k]
        one, other = (controller.step(shown, reference, motors) for controller in pair)
        assert same(one, other), k
        statuses.add(one.status)
        angle = one.predicted_angle[1] + 1e-5 * rng.normal() + (0.5 if k == 250 else 0.0)
        if not np.isfinite(angle):
            angle = 0.0
    assert len(statuses) > 2


@with_compiler
def test_one_form_goes_on_where_the_other_stops() -> None:
    whole, mixed = (four_hertz(ServoModel.paper(), PAPER) for _ in range(2))
    compiled = mixed._step
    for k in range(60):
        mixed._step = mixed._interpreted if k % 7 < 3 else compiled
        angle, reference = 1e-3 * np.sin(0.1 * k), 0.1 * np.sin(0.02 * k)
        assert same(whole.step(angle, reference), mixed.step(angle, reference)), k


def test_without_a_compiler_it_works_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as bare:
        bare.setattr(machine_code, "compiler", lambda: None)
        controller = four_hertz(ServoModel.paper(), PAPER)
    assert not controller.compiled
    assert controller._machine_code.compile_time == 0.0
    assert controller.step(0.0, 0.01).status == "optimal"


@with_compiler
@pytest.mark.parametrize("model", MODELS)
def test_the_machine_code_is_plain_c99(model: str, tmp_path: Path) -> None:
    code = four_hertz(MODELS[model], PAPER, motor_resolution=1e-3)._machine_code.source
    assert "malloc" not in code
    (tmp_path / "step.c").write_text(code)
    strict = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-Wno-unused-function", "-c", "step.c")
    result = subprocess.run([*(machine_code.compiler() or ()), *strict], cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


@with_compiler
def test_a_second_controller_finds_the_machine_code_of_the_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(file_cache, "_cache", lambda: tmp_path)
    controllers = []
    for horizon, inertia in ((10, 2.0), (40, 3.0)):  # neither is part of the source code
        controllers.append(four_hertz(ServoModel(inertia=inertia), PAPER, horizon=horizon))
        assert len(list(tmp_path.glob("controller-*/*.so"))) == 1
    assert all(controller.compiled for controller in controllers)
    assert controllers[0]._machine_code.compile_time > 0.01
    assert controllers[1]._machine_code.compile_time == 0.0


@pytest.mark.parametrize("gears", [PAPER, UNEQUAL], ids=["paper", "unequal"])
@pytest.mark.parametrize(("rotor", "friction"), [(0.0, 0.0), (1e-5, 0.0), (0.0, 3e-3), (1e-5, 3e-3)])
def test_the_split_is_the_allocators(gears: GearTrain, rotor: float, friction: float) -> None:
    bounds = Bounds(gears=gears, min_torque=0.02, max_torque=0.3, rotor_inertia=rotor, motor_friction=friction)
    drive = DriveInverse(half_width=0.2, back_emf=0.3, limit=1.8)
    numbers, rng = machine(bounds, drive), np.random.default_rng(0)
    for _ in range(200):
        wanted, velocity, acceleration = rng.normal(size=3) * [2.0, 1.0, 20.0]
        ends = np.array(reach()(velocity, acceleration, numbers))[:, 0]
        assert ends == pytest.approx(drive.effective(bounds.reachable(acceleration), velocity), abs=1e-12)
        _, torques, given, margin = (
            np.array(x)[:, 0] for x in allocation()(0.0, wanted, velocity, acceleration, numbers)
        )
        expected = least_effort(bounds, drive.command(wanted, velocity), acceleration)
        assert torques == pytest.approx(expected, abs=1e-12)
        assert given[0] == pytest.approx(drive.effective(gears.output_torque(expected), velocity), abs=1e-12)
        assert margin[0] == pytest.approx(bounds.margin(expected, acceleration), abs=1e-12)
