"""A drive is lost: motion goes on, backlash control does not, the status says so, and the report what it costs."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from antidrive.cli import main
from antidrive.drive_loss import loop_with_drive_loss
from antidrive.experiments.drive_losses import MOMENTS, Losses, LossSettings, experiment, run
from antidrive.experiments.settings import read_settings
from antidrive.scenario import parse_scenario, read_scenario, scenario_text
from antidrive.simulation import rigid_model, run_scenario
from mpc import Control, Controller, closed_loop
from plant.errors import BadParameter
from plant.rig import Rig

Array = NDArray[np.float64]
DT, COUNT = 0.005, 120
RIG = Rig.paper_like()
REFERENCE = 0.02 * (1.0 - np.cos(2.0 * np.pi * np.arange(COUNT) * DT))
CALM = np.zeros(COUNT)


def controller(**more: float) -> Controller:
    tuned = {"bandwidth": 4.0, "torque_noise": 0.05, "disturbance_rate": 1.0}
    return Controller(rigid_model(RIG), RIG.gears, **tuned, **more)


def text(changes: dict[str, str]) -> str:
    found = scenario_text("fail-safe")
    for old, new in changes.items():
        assert old in found
        found = found.replace(old, new)
    return found


def settings(changes: dict[str, str]) -> LossSettings:
    return read_settings(LossSettings, "fail-safe", tomllib.loads(text(changes)))


@cache
def losses() -> Losses:
    return experiment(settings({"runs = 3": "runs = 1", "span = 1.0": "span = 0.3"}), 0)


# The loop.


@pytest.mark.parametrize("drive", [1, 2])
def test_until_a_loss_is_known_the_other_drive_pushes_alone(drive: int) -> None:
    whole = closed_loop(controller(), RIG, REFERENCE, COUNT * DT, 3)
    lost = {"drive": drive, "time": 0.3, "detection": 0.05}
    played = loop_with_drive_loss(controller(), RIG, REFERENCE, CALM, seed=3, **lost)
    np.testing.assert_array_equal(played.angle[:61], whole.angle[:61])
    np.testing.assert_array_equal(played.torques[:60], whole.torques[:60])
    assert np.all(played.torques[60:, drive - 1] == 0.0)
    assert played.torques[60, 2 - drive] == whole.torques[60, 2 - drive] != 0.0
    assert played.status[:70] == ("optimal",) * 70
    assert set(played.status[70:]) == {f"degraded: drive {drive} is lost, and backlash control with it"}
    pushed = played.angle[68] - whole.angle[68]  # by the preload of the drive that is left
    assert np.sign(pushed) == (1 if drive == 1 else -1)
    assert np.max(np.abs(played.angle - REFERENCE)) < 2e-3


def test_motor_encoders_are_ignored_after_a_known_drive_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    requested: list[bool] = []
    step = Controller.step

    def listening(self: Controller, angle: float, wanted: Array, motors: Array | None = None) -> Control:
        assert motors is not None
        requested.append(bool(np.isfinite(motors).all()))
        return step(self, angle, wanted, motors)

    monkeypatch.setattr(Controller, "step", listening)
    seeing = controller(motor_resolution=2 * np.pi / 4096)
    loop_with_drive_loss(seeing, RIG, REFERENCE, CALM, drive=1, time=0.3, seed=0, detection=0.05)
    assert requested == [True] * 70 + [False] * 50


# The closed-loop scenario.


def test_the_summary_reports_by_how_much_the_error_grew() -> None:
    base = replace(read_scenario("drive-loss"), duration=4.0)
    assert base.drive_loss is not None
    quick = replace(base, drive_loss=replace(base.drive_loss, time=2.0), rig={"encoder_noise": 2e-4})
    trial = run_scenario(quick, seed=1)
    summary = trial.summary()
    whole = closed_loop(Controller(rigid_model(RIG), RIG.gears), quick.machine(), quick.wanted, 4.0, 1)
    without, after = (each.angle[400:] - each.reference[400:] for each in (whole, trial.result))
    assert summary["tracking_rms_without_loss"] == pytest.approx(np.sqrt(np.mean(without**2)))
    assert summary["tracking_rms_after_loss"] == pytest.approx(np.sqrt(np.mean(after**2)))
    assert summary["error_growth"] == pytest.approx(np.sqrt(np.mean(after**2) / np.mean(without**2)))
    assert summary["largest_error_after_loss"] == np.max(np.abs(after))
    assert summary["backlash_control"] == "lost"
    np.testing.assert_array_equal(trial.table()["angle_without_loss"], whole.angle)
    drawn = {curve.name for row in trial.figure().rows for curve in row.curves}
    assert "angle, nothing lost" in drawn
    assert any(f"{summary['error_growth']:.4g} times" in line and "is lost" in line for line in trial.sentences())


def test_a_loss_after_the_end_is_none() -> None:
    base = replace(read_scenario("drive-loss"), duration=0.2)
    late = run_scenario(base)
    assert late.summary()["backlash_control"] == "kept"
    assert not any("After the loss" in line for line in late.sentences())


def test_detection_is_read_and_refused_when_negative() -> None:
    known = read_scenario("drive-loss").drive_loss
    assert known is not None
    assert known.detection == 0.02
    with pytest.raises(BadParameter, match="detection"):
        parse_scenario("own", scenario_text("drive-loss").replace("detection = 0.02", "detection = -1.0"))


# Either drive, at every kind of moment.


def test_the_platform_goes_on_whenever_a_drive_is_lost() -> None:
    found = losses()
    assert found.rms.shape == (2, len(MOMENTS), 1)
    assert np.all(found.rms > 1.5 * found.intact)  # the gap shows
    assert np.all(found.rms < 20.0 * found.intact)
    assert np.max(np.abs(found.final)) < 6e-4  # half the gap
    assert np.all(found.rms[0] != found.rms[1])
    assert found.kept.all()
    assert found.parted.all()
    assert found.stated


def test_the_moments_are_what_they_are_called() -> None:
    found = losses()
    speed = np.gradient(found.reference, DT)
    push = np.gradient(speed, DT)
    standing, accelerating, moving, braking = (round(moment / DT) for moment in found.loss)
    assert (speed[standing], push[standing]) == (0.0, 0.0)
    assert push[accelerating] == pytest.approx(1.2, rel=1e-3)
    assert speed[moving] == pytest.approx(np.max(speed), rel=1e-3)
    assert push[braking] == pytest.approx(-1.2, rel=1e-3)


@pytest.mark.long
def test_a_later_reported_loss_pushes_the_load_further() -> None:
    changes = {"runs = 3": "runs = 1", "span = 1.0": "span = 0.02", "detection = 0.02": "detection = 0.1"}
    late = experiment(settings(changes), 0)
    assert late.peak[1, 0] > 3.0 * losses().peak[1, 0]  # drive 1 pushes with gravity; against it friction holds


@pytest.mark.long
def test_the_command_reports_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "quick.toml").write_text(text({"runs = 3": "runs = 1", "span = 1.0": "span = 0.02"}))
    assert main(["simulate", str(tmp_path / "quick.toml"), "--out", str(tmp_path / "out"), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert [(case["drive"], case["moment"]) for case in summary["cases"]] == [(d, m) for d in (1, 2) for m in MOMENTS]
    assert summary["backlash_control_said_lost"] is True
    for case in summary["cases"]:
        growth = case["tracking_rms_after_loss"] / case["tracking_rms_without_loss"]
        assert case["error_growth"] == pytest.approx(growth)
    assert "backlash control is lost" in (tmp_path / "out" / "report.html").read_text()


def test_a_status_without_the_loss_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    def without_report(*_: object) -> Losses:
        return replace(losses(), stated=False)

    monkeypatch.setattr("antidrive.experiments.drive_losses.experiment", without_report)
    assert "does not report" in run(settings({}), 0).results[2]


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("detection = 0.02", "detection = -0.1", "detection"),
        ("runs = 3", "runs = 0", "runs"),
        ("acceleration = 1.2", "acceleration = 0.0", "acceleration"),
        ("encoder_counts = 32768", "encoder_counts = 0", "encoder_counts"),
    ],
)
def test_a_bad_loss_is_named(old: str, new: str, complaint: str) -> None:
    with pytest.raises(BadParameter, match=complaint):
        settings({old: new})
