"""Inverse models: in a tight loop the torque is predicted from the motion, and named effects come from that."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from front_door import antidrive, write_csv, write_model
from tight_loop import COULOMB, GRAVITY, INERTIA, VISCOUS, tight_loop

from diagnosis import diagnose
from identification import Log, Unidentifiable, fit, free_simulation, inverse_log
from identification.between_run_differences import between_run_differences
from identification.feedback import torque_responds
from plant import ServoModel, catalogue, simulate
from plant.effects import CoulombFriction, DeadZone, PreslidingHysteresis, TorqueOffset
from plant.signals import chirp

RUBS = ServoModel(
    inertia=INERTIA, gravity=GRAVITY, viscous_friction=VISCOUS, effects=(CoulombFriction(torque=COULOMB),)
)
FEW = ("coulomb_friction", "torque_offset", "input_delay", "encoder_eccentricity")


@pytest.fixture(scope="module")
def log() -> Log:
    return tight_loop(0, disturbance=0.2)


def test_inertia_is_not_inflated_in_a_tight_loop() -> None:
    log = tight_loop(0, disturbance=1.0)
    forward = fit(log, RUBS.with_effect(DeadZone(half_width=0.0)))
    inverse = fit(log, RUBS, inverse=True)
    assert forward.model.inertia > 1.15 * INERTIA  # the loop answers disturbances, and the motion does not show them
    assert inverse["inertia"].value == pytest.approx(INERTIA, rel=0.05)
    assert inverse["coulomb_friction.torque"].value == pytest.approx(COULOMB, rel=0.05)
    assert inverse["viscous_friction"].value == pytest.approx(VISCOUS, rel=0.1)
    assert inverse.log.measured_unit == "N m"
    assert "inverse model" in str(inverse).splitlines()[0]
    assert inverse.model_file().sample_time == pytest.approx(0.005, rel=1e-6)  # of a controller that follows


def test_friction_is_named_by_the_inverse_model(log: Log) -> None:
    found = diagnose(log, inverse=True, exclude=("periodic_disturbance", "payload_change", "friction_drift"))
    named = {cause.effect: cause for cause in found.causes if cause.probability > 0.9}
    assert set(named) == {"coulomb_friction"}
    assert named["coulomb_friction"].parameters["torque"].value == pytest.approx(COULOMB, rel=0.1)
    assert found.to_dict()["data"]["read_as"] == "measured"
    assert found.gain.unit == "N m"
    assert found.gain.cut > 0.5
    assert found.torque_error.held_out_after < 0.5 * found.torque_error.held_out_before
    (reason,) = {r.reason for r in found.rejected if r.effect in ("input_delay", "encoder_eccentricity", "backlash")}
    assert reason == "this log cannot show it"
    assert any("predicted from the motion (inverse model)" in warning for warning in found.warnings)


def test_an_unknown_motion_has_a_hint_at_the_inverse_model() -> None:
    found = diagnose(tight_loop(0, disturbance=0.2, duration=15.0), candidates=FEW[:2])
    assert found.verdict == "unknown"
    assert found.base.log.response == "angle"
    (hint,) = (warning for warning in found.warnings if "--inverse" in warning)
    assert "the torque shows Coulomb friction with a probability above 90 %" in hint


def test_a_motion_that_is_explained_is_not_read_inversely() -> None:
    time = 0.005 * np.arange(3000)
    torque = 4.0 * np.sin(2 * np.pi * 0.4 * time) + 2.0 * np.sin(2 * np.pi * 1.1 * time + 1.0)
    path = simulate(RUBS.with_effect(CoulombFriction(torque=0.5)), command=torque, dt=0.005, substeps=8)
    angle = path[:-1, 0] + 1e-4 * np.random.default_rng(0).normal(size=3000)
    found = diagnose(Log.from_arrays(time=time, torque=torque, angle=angle), candidates=FEW)
    assert found.verdict == "named"
    assert found.base.log.response == "angle"
    assert found.to_dict()["data"]["read_as"] == "command"
    assert not any("inverse" in warning for warning in found.warnings)


def test_the_report_says_torque_where_a_torque_is_predicted(log: Log, tmp_path) -> None:
    found = diagnose(log, candidates=("coulomb_friction", "torque_offset"), inverse=True)
    assert "On the validation run the torque error falls" in str(found)
    assert "simulation" not in str(found.explain())
    found.report(tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "predicted from the motion" in text
    assert "simulated from the command alone" not in text


def test_a_torque_responds_to_the_motion_in_a_loop_alone(log: Log) -> None:
    assert torque_responds(log)
    noise = np.random.default_rng(0).normal(size=(2, 4000))
    swept = chirp(amplitude=2.0, start=0.1, stop=3.0, duration=20.0, sample_time=0.005)
    for torque in (np.repeat(noise[0, :200], 20), swept[:4000]):
        angle = simulate(RUBS, command=torque, dt=0.005, substeps=4)[:-1, 0] + 1e-4 * noise[1]
        assert not torque_responds(Log.from_arrays(time=0.005 * np.arange(4000), torque=torque, angle=angle))


def test_slopes_of_the_needed_torque_are_exact(log: Log) -> None:
    """Of friction that depends on its past, on the torque and on the motion."""
    read = inverse_log(log)
    model = RUBS.with_effect(PreslidingHysteresis(torque=1.0, stiffness=60.0)).with_effect(TorqueOffset(torque=0.2))
    model = model.with_effect(catalogue["load_dependent_friction"](coefficient=0.1))
    problem = _problem(read, model)
    values, nothing = model.values, np.empty((1, 0))
    predicted = partial(problem.predictor.predict, initial=nothing, bandwidth=0.0, width=0.0)
    (here,) = predicted(values)
    for column, place in enumerate(problem.free):
        step = 1e-6 * max(abs(values[place]), 1.0)
        moved = [values.copy(), values.copy()]
        moved[0][place] += step
        moved[1][place] -= step
        ahead, behind = (predicted(each, sensitivities=False)[0].errors for each in moved)
        slope = (ahead - behind) / (2.0 * step)
        assert np.max(np.abs(here.jacobian[:, column] - slope)) < 1e-5 * max(float(np.max(np.abs(slope))), 1.0)


def test_samples_at_rest_are_masked() -> None:
    time = 0.005 * np.arange(6000)
    angle = np.where(time < 15.0, np.cos(0.4 * np.pi * time), -1.0)
    read = inverse_log(Log.from_arrays(time=time, torque=np.sin(time), angle=np.round(angle, 6)))
    (run,) = read.runs
    assert not run.valid[run.time > 15.5].any()
    assert run.valid[(run.time > 1.0) & (run.time < 14.0)].mean() > 0.9


def test_a_log_without_an_inverse_model_is_refused(log: Log) -> None:
    (run,) = log.runs
    servo = replace(log, runs=(replace(run, servo_gain=np.full(len(run), 5.0)),))
    with pytest.raises(Unidentifiable, match="set-point of a position servo"):
        inverse_log(servo)
    speed = Log.from_arrays(time=run.time, torque=run.command, velocity=np.gradient(run.output, run.time))
    with pytest.raises(Unidentifiable, match="needs the angle"):
        inverse_log(speed)
    still = replace(log, runs=(replace(run, output=np.full(len(run), 0.3)),))
    with pytest.raises(Unidentifiable, match="at rest in nearly all samples"):
        fit(still, inverse=True)


def test_runs_of_an_inverse_log_are_compared() -> None:
    first, second = (tight_loop(seed, disturbance=0.1, duration=20.0) for seed in (1, 2))
    (run,) = second.runs
    heavier = replace(run, command=run.command * 1.5)
    both = Log.merge([first, replace(second, runs=(heavier,))])
    assert between_run_differences(fit(Log.merge([first, second]), RUBS, inverse=True)) is None
    found = between_run_differences(fit(both, RUBS, inverse=True))
    assert found is not None
    assert "inertia" in found or "coulomb_friction" in found


def test_a_payload_of_a_run_is_part_of_its_needed_torque() -> None:
    log = tight_loop(4, disturbance=0.0, noise=0.0, coulomb=0.0)
    (run,) = log.runs
    light = ServoModel(inertia=INERTIA - 0.3, gravity=GRAVITY - 1.0, viscous_friction=VISCOUS)
    loaded = replace(log, runs=(replace(run, own={"inertia": 0.3, "gravity": 1.0}),))
    found = fit(loaded, light, inverse=True)
    assert found["inertia"].value == pytest.approx(INERTIA - 0.3, abs=0.02)
    assert found["gravity"].value == pytest.approx(GRAVITY - 1.0, abs=0.02)


def test_the_needed_torque_is_the_output(log: Log) -> None:
    """Without friction and disturbance it is eq. (4), to the accuracy of the low pass."""
    read = inverse_log(tight_loop(3, disturbance=0.0, noise=0.0, coulomb=0.0))
    (run,) = read.runs
    (needed,) = free_simulation(read, RUBS.without_effect("coulomb_friction"))
    error = (run.measured - needed)[run.valid]
    assert float(np.sqrt(np.mean(error**2))) < 0.01 * float(np.std(run.measured))


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> Path:
    (run,) = tight_loop(0, disturbance=1.0, duration=20.0).runs
    folder = tmp_path_factory.mktemp("loop")
    return write_csv(folder / "log.csv", {"time": run.time, "torque": run.command, "angle": run.output})


def test_commands_predict_the_torque_where_that_is_asked_for(file: Path, tmp_path: Path) -> None:
    base = write_model(tmp_path / "base.json", RUBS)
    inertia = {}
    for option in ("--inverse", "--no-inverse"):
        result = antidrive("identify", file, "--base", base, option, "--json", "--out", tmp_path / "out")
        assert result.code == 0, result.err
        inertia[option] = json.loads(result.out)["parameters"]["inertia"]["value"]
        page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
        assert ("The torque, predicted from the motion." in page) == (option == "--inverse")
    assert inertia["--inverse"] == pytest.approx(INERTIA, rel=0.08)
    assert inertia["--no-inverse"] > 1.2 * INERTIA


def test_a_log_file_says_that_the_torque_follows_the_motion(file: Path) -> None:
    toml = file.with_name("log.toml")
    toml.write_text(f'files = ["{file.name}"]\n[fit]\ninverse = true\ncandidates = ["coulomb_friction"]\n')
    result = antidrive("diagnose", toml, "--json", "--out", file.parent / "out")
    assert result.code == 0, result.err
    content = json.loads(result.out)
    assert content["data"]["read_as"] == "measured"
    assert content["gain"]["unit"] == "N m"
    toml.write_text(f'files = ["{file.name}"]\n[fit]\ninverse = 1\n')
    refused = antidrive("diagnose", toml, "--out", file.parent / "none")
    assert (refused.code, refused.err.count("\n")) == (2, 1)
    assert "[fit] inverse must be true or false, not 1" in refused.err


def _problem(log: Log, model: ServoModel):
    from identification.problem import Problem

    return Problem.of(log, model)
