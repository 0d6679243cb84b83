"""The quick friction test: staircases and slow sweeps give back the friction that was in them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from front_door import antidrive, listing, write_csv

from identification import Log
from identification.errors import Unidentifiable
from identification.friction_test import friction_test
from plant import ServoModel, read_model, simulate
from plant.effects import CoulombFriction, StribeckFriction, TorqueOffset

SHARED = Path(__file__).parents[1].parent / "shared"
DT = 0.005
KP, KD = 80.0, 2.0
STRIBECK = ServoModel(
    inertia=0.02,
    gravity=0.1,
    viscous_friction=0.05,
    effects=(StribeckFriction(coulomb=0.2, excess=0.1, velocity=0.15), TorqueOffset(torque=0.03)),
)
PLAIN = ServoModel(inertia=0.02, gravity=0.0, viscous_friction=0.05, effects=(CoulombFriction(torque=0.2),))
STAIRCASE = np.repeat([0.1, 0.3, 0.8, 1.5, -0.1, -0.3, -0.8, -1.5], 700)
SWEEP = 1.5 * (2.0 / np.pi) * np.arcsin(np.sin(2.0 * np.pi * np.arange(6000) * DT / 15.0))


def driven(model: ServoModel, speed: np.ndarray, seed: int = 0) -> dict[str, np.ndarray]:
    """What a drive with a position loop records while it follows a speed."""
    goal = np.cumsum(speed) * DT
    states = simulate(model, command=KP * goal, dt=DT, servo_gain=KP, servo_damping=KD)
    angle, noise = states[:, 0], np.random.default_rng(seed)
    torque = KP * (goal - 0.5 * (angle[:-1] + angle[1:])) - KD * np.diff(angle) / DT
    return {
        "time": np.arange(speed.size) * DT,
        "torque": torque + 0.01 * noise.standard_normal(speed.size),
        "angle": angle[:-1] + 1e-4 * noise.standard_normal(speed.size),
    }


@pytest.mark.parametrize("speed", [STAIRCASE, SWEEP], ids=["staircase", "sweep"])
def test_stribeck_friction_is_found(speed):
    found = friction_test(Log.from_arrays(**driven(STRIBECK, speed)))
    wanted = {"coulomb": 0.2, "excess": 0.1, "stribeck_velocity": 0.15, "viscous": 0.05, "offset": -0.03}
    for name, value in wanted.items():
        assert found.values[name] == pytest.approx(value, abs=max(3.0 * found.std[name], 0.05 * abs(value))), name
        assert found.std[name] < 0.15 * abs(value)
    assert found.values["gravity"] == pytest.approx(0.1, abs=0.003)
    assert not found.one_way
    assert np.abs(found.curve(found.velocity) - found.torque).max() < 0.02
    if speed is SWEEP:
        model = found.model
        assert model is not None
        assert model.effect("torque_offset").torque == pytest.approx(0.03, abs=0.002)
        assert model.inertia == pytest.approx(0.02, rel=0.3)


def test_plain_friction_gets_no_stribeck_curve():
    for seed in range(3):
        found = friction_test(Log.from_arrays(**driven(PLAIN, STAIRCASE, seed)))
        assert "excess" not in found.values
        assert found.values["coulomb"] == pytest.approx(0.2, abs=0.003)
        assert any(line.startswith("No Stribeck friction is visible; the slowest") for line in found.sentences())


def test_a_staircase_has_a_group_for_each_speed():
    found = friction_test(Log.from_arrays(**driven(STRIBECK, STAIRCASE)))
    large = found.velocity[found.windows > 10]
    assert large == pytest.approx([-1.5, -0.8, -0.3, -0.1, 0.1, 0.3, 0.8, 1.5], abs=0.01)
    assert list(found.to_frame()) == ["velocity", "torque", "error", "windows", "curve"]


def test_slow_speeds_are_not_averaged():
    """Friction changes most where speeds lie close to each other."""
    speeds = [0.05, 0.1, 0.2, 0.4, 0.8, 3.2]
    found = friction_test(Log.from_arrays(**driven(STRIBECK, np.repeat([*speeds, *(-v for v in speeds)], 500))))
    large = found.velocity[found.windows > 10]
    assert large == pytest.approx(sorted([*speeds, *(-v for v in speeds)]), abs=0.01)


def test_one_direction_leaves_the_offset_in_the_friction():
    found = friction_test(Log.from_arrays(**driven(STRIBECK, np.abs(STAIRCASE))))
    assert found.one_way
    assert "offset" not in found.values
    assert found.values["coulomb"] == pytest.approx(0.2 - 0.03, abs=0.01)
    assert "one way only" in found.sentences()[0]


def test_friction_below_zero_is_reported():
    log = driven(PLAIN, STAIRCASE)
    found = friction_test(Log.from_arrays(**{**log, "torque": -log["torque"]}))
    assert any(line.startswith("The friction is negative") for line in found.sentences())
    assert found.model is None or found.model.effect("coulomb_friction") is None


@pytest.mark.parametrize("speed", [STAIRCASE, SWEEP], ids=["staircase", "sweep"])
def test_negative_friction_leaves_no_model(speed, tmp_path):
    """Nor the model.json of an earlier run, which would pass for its result."""
    table, out = driven(STRIBECK, speed), tmp_path / "out"
    table["torque"] = 0.05 * np.gradient(np.gradient(table["angle"], DT), DT) - table["torque"]
    out.mkdir()
    (out / "model.json").write_text("{}")
    (out / "notes.txt").write_text("mine")
    spoken = antidrive("friction", write_csv(tmp_path / "log.csv", table), "--out", out)
    assert spoken.code == 0, spoken.err
    assert "No model.json: the friction is negative. friction.csv is the table." in spoken.out.splitlines()
    assert f"The model.json of an earlier run was removed from {out}." in spoken.out.splitlines()
    assert sorted(listing(out)) == ["friction.csv", "friction.json", "notes.txt", "report.html"]


def test_a_refused_log_leaves_an_earlier_model(tmp_path):
    log = write_csv(tmp_path / "log.csv", driven(PLAIN, np.full(2000, 0.5)))
    (tmp_path / "model.json").write_text("{}")
    assert antidrive("friction", log, "--out", tmp_path).code == 2
    assert (tmp_path / "model.json").exists()


def test_stribeck_friction_below_all_speeds_is_not_claimed():
    """Between the slowest speed and rest a hump of any height fits."""
    goal = np.cumsum(STAIRCASE) * DT
    angle = simulate(PLAIN, command=400.0 * goal, dt=DT, servo_gain=400.0, servo_damping=5.0)[:-1, 0]
    angle += 1e-4 * np.random.default_rng(0).standard_normal(goal.size)
    found = friction_test(Log.from_arrays(time=np.arange(goal.size) * DT, setpoint=goal, angle=angle))
    assert found.values.get("excess", 0.0) < 10.0 * found.values["coulomb"]


@pytest.mark.parametrize("speed", [np.full(2000, 0.5), np.zeros(2000)], ids=["one speed", "rest"])
def test_one_speed_is_not_enough(speed):
    with pytest.raises(Unidentifiable, match="one speed at most"):
        friction_test(Log.from_arrays(**driven(PLAIN, speed)))


def test_a_staircase_with_an_idle_tail_is_understood():
    log = SHARED / "cases" / "logs" / "05-staircase-idle-tail" / "log.csv"
    if not log.exists():
        pytest.skip("the case is not here")
    found = friction_test(Log.read(log))
    assert found.one_way
    assert found.values["viscous"] == pytest.approx(7.6e-4, rel=0.05)  # as the case's author found by hand
    assert found.values["coulomb"] == pytest.approx(0.052, rel=0.05)


def test_the_command_writes_points_curve_and_model(tmp_path):
    log, out = write_csv(tmp_path / "sweep.csv", driven(STRIBECK, SWEEP)), tmp_path / "out"
    result = antidrive("friction", log, "--out", out)
    assert result.code == 0, result.err
    assert sorted(listing(out)) == ["friction.csv", "friction.json", "model.json", "report.html"]
    assert listing(out)["friction.csv"].decode().splitlines()[0].startswith("velocity [rad/s],torque [N m],error [N m]")
    assert result.out.startswith("Coulomb friction F_c: 0.2")
    content = json.loads((out / "friction.json").read_text())
    assert content["parameters"]["excess"]["unit"] == "N m"
    read = read_model(out / "model.json")
    assert read.std["stribeck_friction.coulomb"] == content["parameters"]["coulomb"]["std"]
    assert antidrive("table", "friction", out / "model.json", "--out", out).code == 0


def test_the_command_reports_what_is_wrong(tmp_path):
    log = write_csv(tmp_path / "log.csv", driven(PLAIN, np.full(2000, 0.5)))
    result = antidrive("friction", log, "--out", tmp_path / "out")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert not (tmp_path / "out").exists()


def test_no_friction_is_not_called_negative():
    smooth = ServoModel(inertia=0.02, gravity=0.0, viscous_friction=0.05)
    for seed in range(3):
        lines = friction_test(Log.from_arrays(**driven(smooth, SWEEP, seed))).sentences()
        assert "No Coulomb friction is visible." in lines
        assert not any("negative" in line for line in lines)


def test_a_stribeck_curve_never_drives():
    """A multisine has few windows without a reversal: as many terms would meet them almost exactly."""
    time = np.arange(12_000) * DT
    parts = zip((0.9, 0.7, 0.5, 0.3), (0.17, 0.43, 0.9, 1.9), strict=True)
    speed = sum(size * np.sin(2.0 * np.pi * rate * time + 7.0 * rate) for size, rate in parts)
    found = friction_test(Log.from_arrays(**driven(STRIBECK, speed)))
    assert found.values["coulomb"] >= 0.0
    slow = np.array([-0.02, 0.02])
    assert np.all(np.sign(slow) * (found.curve(slow) - found.values.get("offset", 0.0)) >= 0.0)
