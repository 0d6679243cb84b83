"""A small fast servo is told what a large slow one is: nothing in a diagnosis hangs on the units of torque and time."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from hidden_effects import CASES, Hidden, logs_of
from machine import excitation, record

from diagnosis import diagnose
from diagnosis.holdout import restart_window, squared_errors
from identification.log import Log
from identification.problem import Problem
from plant import BadModelFile, ModelFile, ServoModel, read_model
from plant.discrete import integration_steps
from plant.effects import ActuatorLag, Backlash, Compliance, PayloadChange, PreslidingHysteresis
from plant.effects.effect import POSITIVE, parameters_of

TORQUE, TIME = 1e-4, 0.05  # of the small servo over the large one's: half a second of samples 0.25 ms apart
ALTERNATIVES = ["backlash", "compliance", "input_delay", "actuator_lag"]
SIZES = {"compliance": 0.34}


def smaller(log: Log, torque: float = TORQUE, time: float = TIME) -> Log:
    """What a servo would log that does the same with less torque in less time."""
    runs = (replace(run, time=time * run.time, command=torque * run.command) for run in log.runs)
    return replace(log, runs=tuple(runs))


@pytest.mark.parametrize("case", [case for case in CASES if case.effect in SIZES], ids=lambda case: case.effect)
def test_the_drivetrain_of_a_small_servo_is_named(case: Hidden) -> None:
    """Once no swing above 1000 rad/s was looked for: a spring then was nothing at all."""
    size = SIZES[case.effect]
    log, held_out = (smaller(log) for log in logs_of(case.machine(size), seed=12, duration=10.0))
    found = diagnose(log, None, held_out, candidates=ALTERNATIVES)
    (cause,) = found.causes
    assert (found.verdict, cause.effect) == ("named", case.effect)
    assert "flank_frequency" not in cause.parameters  # it is stated, and no finding
    for name in case.judged:
        scale = 1.0 / TIME if name == "frequency" else 1.0
        assert cause.parameters[name].value == pytest.approx(scale * case.at(size)[name], rel=0.1)


@pytest.mark.parametrize(
    ("kind", "name", "expected"),
    [
        (Compliance, "frequency", {0.02: (0.5, 100.0), 0.005: (0.5, 400.0), 0.00025: (0.5, 8000.0)}),
        (Backlash, "motor_share", {0.005: (0.02, 0.98)}),
        (PayloadChange, "time", {0.005: (3.0, 7.0)}),
        (ActuatorLag, "time_constant", {0.005: (POSITIVE, pytest.approx(0.4))}),
    ],
)
def test_what_a_log_can_determine_has_bounds(kind: type, name: str, expected: dict[float, tuple[float, float]]) -> None:
    (spec,) = (spec for spec in parameters_of(kind) if spec.name == name)
    for sample_time, bounds in expected.items():
        assert spec.bounds(3.0, 7.0, sample_time) == bounds


def test_a_fit_keeps_bounds_and_fixed_values() -> None:
    log, _ = logs_of(CASES[0].machine(0.005), seed=12, duration=2.0)
    problem = Problem.of(smaller(log), ServoModel(effects=(Compliance(frequency=300.0, damping=0.1, motor_share=0.3),)))
    free = [problem.model.names[place] for place in problem.free]
    assert problem.upper[free.index("compliance.frequency")] == pytest.approx(8000.0)
    stated = Problem.of(log, ServoModel(effects=(Backlash(gap=0.01, motor_share=0.3),)))
    assert [stated.model.names[place] for place in stated.free][-2:] == ["backlash.gap", "backlash.motor_share"]


@pytest.mark.parametrize(
    ("effect", "sample_time", "steps"),
    [
        (Compliance(frequency=30.0, damping=0.1, motor_share=0.3), 0.005, 2),
        (
            Compliance(frequency=30.0, damping=0.1, motor_share=0.3),
            0.00025,
            2,
        ),  # of up to 8000 rad/s while it is fitted
        (Compliance(frequency=8000.0, damping=0.1, motor_share=0.3), 0.005, 40),  # where the controller is slower
        (Backlash(gap=0.01, motor_share=0.3), 0.005, 8),
        (Backlash(gap=0.01, motor_share=0.3, flank_frequency=8000.0), 0.00025, 8),
    ],
)
def test_the_steps_of_integration_follow_the_fastest_swing(
    effect: Compliance | Backlash, sample_time: float, steps: int
) -> None:
    assert integration_steps(ServoModel(effects=(effect,)), sample_time) == steps


@pytest.mark.parametrize(("factor", "vanishes"), [(0.5e-4, True), (2e-4, False), (0.5, False), (2.0, True)])
@pytest.mark.parametrize(("sample_time", "second"), [(0.02, 4.0), (0.005, 1.0), (0.00025, 0.05)])
def test_a_travel_to_slide_differs_from_none_at_any_speed(
    factor: float, vanishes: bool, sample_time: float, second: float
) -> None:
    speed, torque = 3.0, 0.2
    spring = PreslidingHysteresis(torque=torque, stiffness=torque / (factor * second * speed))
    assert spring.vanishes(speed, sample_time) == vanishes


def test_a_model_file_from_before_the_flanks_were_stated_is_read(tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    model = ServoModel(effects=(Backlash(gap=0.01, motor_share=0.3, flank_frequency=900.0),))
    ModelFile(model=model, std={}).write(path)
    assert read_model(path).model == model
    content = json.loads(path.read_text())
    del content["effects"][0]["parameters"]["flank_frequency"]
    path.write_text(json.dumps(content))
    assert read_model(path).model == ServoModel(effects=(Backlash(gap=0.01, motor_share=0.3),))
    del content["effects"][0]["parameters"]["gap"]
    path.write_text(json.dumps(content))
    with pytest.raises(BadModelFile, match="'gap' is missing"):
        read_model(path)


@pytest.mark.parametrize("time", [0.05, 4.0])
def test_multi_step_windows_scale_with_the_machine(time: float) -> None:
    """Fixed at a second, a slow machine's starts were found from too few samples to tell anything."""
    log = record(CASES[0].machine(0.005), excitation(5, duration=30.0), seed=3).log()
    assert restart_window(log) == pytest.approx(1.0)
    assert restart_window(smaller(log, time=time)) == pytest.approx(time, rel=0.6)
    model = ServoModel.paper()
    other = replace(model, inertia=time**2 * model.inertia, viscous_friction=time * model.viscous_friction)
    for window in (None, 1.0):
        here, _ = squared_errors(log, model, window)
        there, _ = squared_errors(smaller(log, torque=1.0, time=time), other, window and window * time)
        assert there.mean() == pytest.approx(here.mean(), rel=0.1)  # a few samples more may be looked at
