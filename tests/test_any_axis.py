"""Any axis: ratios instead of teeth, signed and different, limits of each drive, a linear axis, one drive alone."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from fmu_instance import Slave
from front_door import antidrive, write_model
from target import PAPER, RIGID, built

from allocation import Allocator
from antidrive.scenario import parse_scenario
from antidrive.simulation import run_scenario
from mpc import Controller, closed_loop, controller_fmu
from mpc.export import export
from plant import BadParameter, DriveTrain, Ratios, Rig, ServoModel
from plant.effects import CoulombFriction
from plant.gears import drive_train

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc here")
LIGHT = ServoModel(inertia=0.02, gravity=0.05, viscous_friction=0.02).with_effect(CoulombFriction(torque=0.25))
TRAINS = {
    "signed": Ratios(ratios=(8.05, -4.0), pre_reduction=(10.0, 20.0)),
    "with the load": Ratios(ratios=(8.05, 8.05)),
    "one": Ratios(ratios=(-8.05,)),
}


def within(train: DriveTrain, torques: np.ndarray, least: np.ndarray, most: np.ndarray) -> bool:
    """Whether every torque (T, m) is in its bounds, to the last bit."""
    magnitudes = torques * np.array(train.directions)
    return bool(np.all((magnitudes >= (least if train.drives > 1 else -most)) & (magnitudes <= most)))


@pytest.mark.parametrize("name", TRAINS)
def test_the_loop_is_closed_and_the_bounds_hold_with_any_drives(name: str) -> None:
    train = TRAINS[name]
    least, most = (np.array([0.02, 0.03])[: train.drives], np.array([0.3, 0.5])[: train.drives])
    limits = {"min_torque": tuple(least.tolist()), "max_torque": tuple(most.tolist())}
    rig = Rig(gears=train, drives=tuple(range(1, train.drives + 1)), inertia=2.0, gravity=0.5, viscous_friction=0.8,
              rotor_inertia=1e-5, motor_viscous=0.0)  # fmt: skip
    model = ServoModel(inertia=rig.total_inertia, gravity=0.5, viscous_friction=0.8)
    controller = Controller(model, train, motor_resolution=1e-4, **limits)  # type: ignore[arg-type]
    found = closed_loop(controller, rig, lambda time: 0.1 * (1 - np.cos(2 * time)), 3.0, seed=0)
    assert found.degraded == 0
    assert np.sqrt(np.mean((found.angle - found.reference)[200:] ** 2)) < 2e-3
    assert within(train, found.torques, least, most)
    assert found.torques.shape == (600, train.drives)
    if train.drives > 1:
        assert found.minimum_contact_torque > 0.0


def test_ratios_of_a_gear_train_are_that_gear_train() -> None:
    same, teeth = Ratios(ratios=(-8.05, -8.05), pre_reduction=PAPER.pre_reduction), PAPER
    one, other = (Controller(RIGID, train, motor_resolution=1e-3, rotor_inertia=1e-6) for train in (same, teeth))
    for k in range(60):
        motors = -1e-4 * k * PAPER.motor_ratios
        controls = [each.step(1e-4 * k, 0.3, motors) for each in (one, other)]
        np.testing.assert_allclose(controls[0].torques, controls[1].torques, rtol=1e-12)
    for name in ("torque_map", "angle_map", "motor_ratios", "mesh_ratios", "directions"):
        np.testing.assert_allclose(getattr(same, name), getattr(teeth, name), rtol=1e-14)
    np.testing.assert_allclose(same.pinion_torques(1.2, 0.4), teeth.pinion_torques(1.2, 0.4 / 20), rtol=1e-14)


def test_a_linear_axis_is_controlled_by_the_same_numbers() -> None:
    """The equations know no unit: a mass in place of an inertia gives the same torques, to the last bit."""
    rotary = ServoModel(inertia=3.0, gravity=0.0, viscous_friction=1.0)
    linear = ServoModel(inertia=3.0, gravity=0.0, viscous_friction=1.0, axis="linear")
    train = Ratios(ratios=(60.0, -60.0))
    controllers = [Controller(model, train) for model in (rotary, linear)]
    for k in range(60):
        torques = [each.step(1e-4 * k, 0.3).torques for each in controllers]
        np.testing.assert_array_equal(*torques)
    with pytest.raises(BadParameter, match="Ratios"):
        Controller(linear, PAPER)


@needs_gcc
@pytest.mark.parametrize("name", TRAINS)
def test_exported_code_gives_the_torques_of_python(name: str, tmp_path: Path) -> None:
    train = TRAINS[name]
    axis = "linear" if name == "signed" else "rotary"
    model = ServoModel(inertia=2.0, gravity=0.0, viscous_friction=1.5, axis=axis)  # type: ignore[arg-type]
    controller, again = (Controller(model, train, max_torque=0.4, motor_resolution=1e-3) for _ in range(2))
    files = export(controller, name="axis").files
    rng, lines, expected = np.random.default_rng(0), [], []
    for k in range(200):
        shown, motors = 1e-3 * k + rng.normal(scale=2e-5), -1e-3 * k * np.copysign(train.motor_ratios, train.angle_map)
        control = again.step(shown, 0.3, motors if k % 7 else None)
        expected.append(control.torques)
        cells = [shown, *(motors if k % 7 else np.full(train.drives, np.nan)), 0.3]
        lines.append(",".join(repr(float(cell)) for cell in cells) + "\n")
    program = built(files, tmp_path)
    torques = played_any(program, "".join(lines))
    np.testing.assert_array_equal(torques, expected)
    header = files["axis_controller.h"]
    assert f"AXIS_DRIVES = {train.drives}," in header
    low = float(header.split("AXIS_TORQUE_1_LOW (")[1].split(")")[0])
    assert low == (-0.4 if train.directions[0] < 0 or train.drives == 1 else 0.02)
    assert ("position" in files["README.txt"]) == (axis == "linear")


def played_any(program: Path, lines: str) -> np.ndarray:
    """Torques (T, m) that a driver answers."""
    printed = subprocess.run([program], input=lines, capture_output=True, text=True, check=True).stdout.splitlines()
    return np.array([[float(cell) for cell in line.split(",")[:-1]] for line in printed[1:]])


@needs_gcc
def test_an_fmu_of_one_drive(tmp_path: Path) -> None:
    controller = Controller(RIGID, TRAINS["one"])
    slave = Slave(controller_fmu(controller), tmp_path)
    slave.sample(angle=0.1, reference=0.1)
    assert slave.get("torque_1") == controller.step(0.1, 0.1).torques.tolist()
    assert "torque_2" not in slave.variables
    slave.close()


def test_one_drive_is_allocated_all_of_the_torque() -> None:
    allocator = Allocator(TRAINS["one"], min_torque=0.02, max_torque=0.3)
    assert allocator.allocate(1.0).torques == pytest.approx([-1.0 / 8.05])
    assert allocator.allocate(-1.0).status == "optimal"
    too_much = allocator.allocate(5.0)
    assert too_much.torques == pytest.approx([-0.3])
    assert "out of reach" in too_much.status


@pytest.mark.parametrize(
    ("text", "train"),
    [
        ("20,31:161", "20,31:161"),
        ("8.05", "8.05,8.05"),
        ("8.05,-4", "8.05,-4.0"),
    ],
)
def test_drives_are_read_as_they_are_written(text: str, train: str) -> None:
    assert str(drive_train(text)) == train
    assert drive_train(str(drive_train(text))) == drive_train(text)


@pytest.mark.parametrize("bad", [(), (1.0, 2.0, 3.0), (0.0,), (np.nan, 1.0)])
def test_ratios_that_cannot_be_are_refused(bad: tuple[float, ...]) -> None:
    with pytest.raises(BadParameter):
        Ratios(ratios=bad)
    with pytest.raises(BadParameter, match="pre_reduction"):
        Ratios(ratios=(1.0, 2.0), pre_reduction=0.0)


SHORT = """title = "short"
duration = 2.0
sample_time = 0.002
[reference]
kind = "sine"
amplitude = 0.1
frequency = 0.5
[controller]
max_torque = [0.3, 0.2]
angle_limits = [-1.0, 1.0]
"""


def test_a_model_is_tried_on_a_bench_of_its_own() -> None:
    """It was tried on the paper's 2 kg m^2: 0.177 rad, silently."""
    trial = run_scenario(parse_scenario("short", SHORT), model=LIGHT, train=Ratios(ratios=(5.0, -5.0)))
    print(trial.sentences())
    assert trial.summary()["tracking_rms"] < 2e-3
    assert not trial.summary()["contact_lost"]
    assert trial.sentences()[0] == "The test-bench simulation is built from the model: 0.02 kg m^2, drives 5.0,-5.0."
    own = run_scenario(parse_scenario("own", SHORT + "[rig]\ninertia = 2.0\n"), model=LIGHT)
    assert own.summary()["tracking_rms"] > 5 * trial.summary()["tracking_rms"]
    assert "that of the scenario, 2.079 kg m^2" in own.sentences()[0]


def test_what_no_bench_has_is_not_made_up_for_on_it() -> None:
    """The inverse of a dead zone jumps where the torque turns; on a bench without one that cost contact."""
    model = ServoModel.paper()  # with a dead zone of 0.5 N m
    trial = run_scenario(parse_scenario("short", SHORT.replace("[0.3, 0.2]", "0.3")), model=model)
    assert not trial.summary()["contact_lost"]
    assert "not in its controller: dead zone" in " ".join(trial.sentences())


def test_the_commands_take_the_drives_and_a_model_of_either_axis(tmp_path: Path) -> None:
    linear = ServoModel(inertia=95.0, gravity=0.0, viscous_friction=200.0, axis="linear")
    model = write_model(tmp_path / "linear.json", linear)
    result = antidrive(
        "capability", "--model", model, "--ratio", "400,-400", "--max-torque", 2, "--out", tmp_path / "map"
    )
    assert result.code == 0, result.err
    assert "from -792 to 792 N at rest" in result.out
    assert "m/s²" in result.out
    result = antidrive("allocate", 100, "--model", model, "--ratio", "400,-300", "--max-torque", "2,1", "--json")
    (found,) = json.loads(result.out)["allocations"]
    assert found["torques"] @ np.array([400, -300]) == pytest.approx(100)
    result = antidrive("export", model, "--ratio", 400, "--one-drive", "--max-torque", 2, "--out", tmp_path / "c")
    assert result.code == 0, result.err
    assert "measured position of the load [m]" in (tmp_path / "c" / "antidrive_controller.h").read_text()
    (tmp_path / "short.toml").write_text(SHORT.replace("[0.3, 0.2]", "2.0"))
    words = ("--ratio", "400,-400", "--encoder-resolution", 1e-6, "--encoder-noise", 1e-6)
    result = antidrive("simulate", tmp_path / "short.toml", "--model", model, *words, "--out", tmp_path / "sim")
    assert result.code == 0, result.err
    assert "µm rms" in result.out
    assert (tmp_path / "sim" / "trajectory.csv").read_text().startswith("time,reference,position,")
    result = antidrive("simulate", tmp_path / "short.toml", "--model", model, "--out", tmp_path / "none")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert "--ratio" in result.err
