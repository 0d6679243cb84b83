"""A model that only follows the motion, whatever the torque is, is no model of the machine, and that is said."""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from machine import Machine, excitation, record

import antidrive as ad
from diagnosis import diagnose, unexplained_torque
from diagnosis.inverse_model import inverse_errors, torque_follows, torque_predicted_worse, unexplained_in_validation
from diagnosis.residual_torque import residual_torque
from identification import Log, Unidentifiable, fit
from identification.fit import base_model
from identification.regression import TorqueRegression, starting_values
from plant import ServoModel
from plant.effects import GravityOffset

TIME = np.arange(0.0, 20.0, 0.005)


def tight_loop(angle_zero: float, disturbance: float) -> Log:
    """A joint that a tight loop moves: its torque follows from the motion and from a slow disturbance [rad, N m]."""
    parts = ((0.6, 0.13, 0.0), (0.4, 0.31, 1.0), (0.2, 0.47, 2.0))
    angle = sum(size * np.sin(2 * np.pi * rate * TIME + phase) for size, rate, phase in parts)
    speed = np.gradient(angle, TIME)
    slow = 4.0 * np.sin(2 * np.pi * 0.21 * TIME + 0.5) + 3.0 * np.sin(2 * np.pi * 0.57 * TIME + 1.5)
    torque = 0.6 * np.gradient(speed, TIME) + 30.0 * np.cos(angle - angle_zero) + 1.5 * speed + disturbance * slow
    noise = 2e-5 * np.random.default_rng(0).normal(size=TIME.size)
    return Log.from_arrays(time=TIME, torque=torque, angle=angle + noise)


def test_a_torque_that_the_model_does_not_explain_is_reported() -> None:
    log = tight_loop(0.0, 0.3)
    heavy = replace(fit(log), model=ServoModel(inertia=60.0, gravity=0.0))  # goes on as the load does
    warning = unexplained_torque(heavy)
    assert warning is not None
    assert "A regression of the torque on the measured motion has an error of" in warning
    regression = TorqueRegression.of(log, 20.0)
    assert regression.inertia == pytest.approx(0.6, rel=0.15)  # the disturbance is a third of the accelerating torque
    assert regression.gravity == pytest.approx(30.0, rel=0.1)
    assert regression.coulomb_friction >= 0.0
    (inertia_text,) = re.findall(r"inertia ([\d.]+) kg m\^2, gravity", warning)
    assert float(inertia_text) == pytest.approx(0.6, rel=0.15)
    noise = np.random.default_rng(1).normal(size=TIME.size)
    other = Log.from_arrays(time=TIME, torque=20.0 * noise, angle=log.runs[0].output)
    assert unexplained_torque(replace(heavy, log=other)) is None  # nothing explains this torque


def test_a_model_that_explains_the_torque_is_not_warned_of() -> None:
    assert unexplained_torque(fit(tight_loop(0.0, 0.0))) is None
    assert unexplained_torque(fit(tight_loop(0.0, 0.3))) is None


def test_another_unit_of_the_validation_data_is_reported() -> None:
    log = tight_loop(0.0, 0.0)
    (run,) = log.runs
    found, thousandth = fit(log), replace(log, runs=(replace(run, command=1e3 * run.command),))
    warning = unexplained_in_validation(found, thousandth)
    assert warning is not None
    assert "The same motion needs 1e+03 times the command in the validation data: check the unit" in warning
    assert unexplained_in_validation(found, log) is None
    against = replace(log, runs=(replace(run, command=-run.command),))  # the same size: not a matter of units
    warning = unexplained_in_validation(found, against)
    assert warning is not None
    assert warning.endswith("has an error of 200 % there.")


def test_a_motion_without_acceleration_shows_no_other_unit() -> None:
    """Its inertia is anything: here 0.04 times that of the other log."""
    angle = 0.8 * np.sin(2 * np.pi * 0.02 * TIME)
    noise, jitter = (np.random.default_rng(seed).normal(size=TIME.size) for seed in (2, 102))
    torque = 30.0 * np.cos(angle) + 1.5 * np.gradient(angle, TIME) + 0.5 * noise
    slow = Log.from_arrays(time=TIME, torque=torque, angle=angle + 2e-5 * jitter)
    assert unexplained_in_validation(fit(tight_loop(0.0, 0.0)), slow) is None


def test_the_advice_for_a_set_point_is_not_to_command_torque() -> None:
    log = tight_loop(0.7, 0.0)
    (run,) = log.runs
    gain = 50.0
    goal = run.output + run.command / gain
    servo = Log.from_arrays(time=TIME, setpoint=goal, angle=run.output, kp=gain)
    assert "the torque is commanded" in str(torque_follows(log, 20.0))
    text = str(torque_follows(servo, 20.0))
    assert "give the drive's torque or current as the command" in text
    assert "the torque is commanded" not in text


def test_a_force_is_in_the_unit_of_the_command() -> None:
    log = tight_loop(0.0, 0.0)
    (run,) = log.runs
    linear = Log.from_arrays(time=TIME, current=run.command, position=run.output)
    assert residual_torque(fit(linear)).unit == "A"


def test_a_hanging_pendulum_in_a_tight_loop_is_diagnosed() -> None:
    """Its base model has gravity over cos x alone: the likelihood of the motion gives it an inertia that is absurd."""
    found = diagnose(tight_loop(np.pi / 2, 0.0))
    assert (found.verdict, [cause.effect for cause in found.causes]) == ("named", ["gravity_offset"])
    assert found.causes[0].parameters["beta"].value == pytest.approx(30.0, rel=1e-3)  # more than any torque in the log
    assert found.extended.model.inertia == pytest.approx(0.6, rel=0.02)


def test_a_torque_that_only_follows_the_motion_is_refused() -> None:
    with pytest.raises(Unidentifiable, match="in this log the torque follows the motion"):
        diagnose(tight_loop(0.7, 0.2), inverse=False)


def test_a_torque_that_follows_the_motion_is_predicted_from_it() -> None:
    log = tight_loop(0.7, 0.1)
    (run,) = log.runs
    noisy = run.command + 0.5 * np.random.default_rng(1).normal(size=TIME.size)
    found = diagnose(
        replace(log, runs=(replace(run, command=noisy),)), candidates=["gravity_offset", "coulomb_friction"]
    )
    assert found.base.log.response == "torque"
    assert [cause.effect for cause in found.causes] == ["gravity_offset"]
    assert found.causes[0].parameters["beta"].value == pytest.approx(30.0 * np.sin(0.7), rel=0.05)
    assert found.model.gravity == pytest.approx(30.0 * np.cos(0.7), rel=0.05)
    assert found.torque_error.held_out_after < 0.1


def test_starts_are_near_the_truth_for_any_zero_of_the_angle() -> None:
    log = tight_loop(np.pi / 2, 0.0)
    assert min(abs(start[0] / 0.6 - 1.0) for start in starting_values(log, base_model(log))) < 0.05


def test_what_does_not_explain_the_torque_leaves_no_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    module = sys.modules["diagnosis.diagnose_once"]
    log = record(Machine().hiding(coulomb_friction={"torque": 0.3}), excitation(2, duration=8.0), seed=2).log()
    monkeypatch.setattr(module, "torque_predicted_worse", lambda error: "worse")
    found = diagnose(log, candidates=["coulomb_friction"])
    assert (found.verdict, "worse" in found.warnings) == ("named", True)
    monkeypatch.setattr(module, "unexplained_torque", lambda fit: "absurd")
    found = diagnose(log, candidates=["coulomb_friction"], inverse=False)
    assert (found.verdict, "absurd" in found.warnings, "worse" in found.warnings) == ("unknown", True, False)


def test_of_an_amplifier_that_drops_out_the_size_is_reported() -> None:
    """No smooth function follows the drop-outs; what is unexplained is the torque that is missing."""
    command = excitation(5, duration=20.0)
    cut = np.arange(command.size) % 340 < 16
    applied = np.where(cut, 0.0, command)
    log = record(Machine(), applied, seed=5).log()
    run = replace(log.runs[0], command=command[: len(log.runs[0])])
    found = diagnose(replace(log, runs=(run,)), candidates=["coulomb_friction", "quadratic_drag"])
    lost = np.sqrt(np.mean((command - applied) ** 2) / np.mean(command**2))
    assert found.verdict == "unknown"
    assert 0.3 * lost < found.unknown.share < 3.0 * lost


def test_an_extension_that_spoils_the_feedforward_is_reported() -> None:
    log, right = tight_loop(0.0, 0.0), ServoModel(inertia=0.6, gravity=30.0, viscous_friction=1.5)
    wrong = right.with_effect(GravityOffset(beta=10.0))
    spoilt = torque_predicted_worse(inverse_errors(log, log, right, wrong))
    assert spoilt is not None
    assert "not as a feedforward" in spoilt
    assert torque_predicted_worse(inverse_errors(log, log, wrong, right)) is None
    assert torque_predicted_worse(inverse_errors(log, log, right, replace(right, viscous_friction=1.51))) is None


def test_a_log_toml_is_read_in_python(tmp_path) -> None:
    log = tight_loop(0.0, 0.0)
    run = log.runs[0]
    rows = np.column_stack((run.time, run.command, np.degrees(run.output)))[:400]
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="t,u,phi", comments="")
    described = 'files = ["log.csv"]\n[columns]\ntime = "t"\ntorque = "u"\nangle = "phi"\n[units]\nangle = "deg"\n'
    (tmp_path / "log.toml").write_text(described)
    read = ad.read_log(tmp_path / "log.toml")
    assert read.runs[0].output == pytest.approx(run.output[:400], abs=1e-6)
