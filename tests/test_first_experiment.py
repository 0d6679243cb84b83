"""The experiment before there is a log: within the limits, and worth its time."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from front_door import antidrive

from identification import Log, fit
from identification.friction_test import friction_test
from plant import BadParameter, DriveLimits, ServoModel, first_experiment, simulate
from plant.effects import CoulombFriction

ARM = DriveLimits(travel=(-1.0, 1.0), speed=5.0, acceleration=50.0)


@pytest.mark.parametrize(
    ("limits", "rate"),
    [
        (ARM, 200.0),
        (DriveLimits(travel=(0.0, 20.0), speed=100.0, acceleration=500.0), 1000.0),
        (DriveLimits(travel=(-3.0, 3.0), speed=0.5, acceleration=1.0), 100.0),
        (DriveLimits(travel=(-0.02, 0.01), speed=0.2, acceleration=20.0), 1000.0),
    ],
)
def test_the_plan_keeps_every_limit_and_uses_most_of_it(limits, rate):
    plan = first_experiment(limits, rate=rate)
    low, high = limits.travel
    assert low < plan["setpoint"].min() < low + 0.06 * (high - low)
    assert high - 0.06 * (high - low) < plan["setpoint"].max() < high
    speed, acceleration = np.diff(plan["setpoint"]) * rate, np.diff(plan["setpoint"], 2) * rate**2
    assert 0.8 * limits.speed < np.abs(speed).max() <= limits.speed
    assert 0.8 * limits.acceleration < np.abs(acceleration).max() <= limits.acceleration
    assert plan["setpoint"].iloc[[0, -1]].tolist() == pytest.approx([0.5 * (low + high)] * 2)
    assert list(dict.fromkeys(plan["part"])) == [
        "rest",
        "chirp",
        "moves and stops",
        "slow reversals",
        "staircase of speeds",
    ]
    assert plan["time"].iloc[-1] < 400.0


def test_a_log_of_the_plan_determines_the_model():
    truth = ServoModel(inertia=0.05, gravity=0.3, viscous_friction=0.1, effects=(CoulombFriction(torque=0.2),))
    goal = first_experiment(ARM)["setpoint"].to_numpy()
    states = simulate(truth, command=200.0 * goal, dt=0.005, servo_gain=200.0, servo_damping=3.0)
    angle, noise = states[:, 0], np.random.default_rng(0)
    torque = 200.0 * (goal - 0.5 * (angle[:-1] + angle[1:])) - 3.0 * np.diff(angle) / 0.005
    log = Log.from_arrays(
        time=0.005 * np.arange(goal.size), torque=torque, angle=angle[:-1] + 1e-4 * noise.standard_normal(goal.size)
    )
    tested = friction_test(log)
    assert tested.values["coulomb"] == pytest.approx(0.2, rel=0.1)
    assert tested.values["viscous"] == pytest.approx(0.1, rel=0.1)


def test_a_torque_plan_keeps_its_limit_and_shows_the_model():
    truth = ServoModel(inertia=0.5, gravity=0.3, viscous_friction=0.4, effects=(CoulombFriction(torque=0.2),))
    plan = first_experiment(DriveLimits(torque=2.0), rate=100.0)
    torque = plan["torque"].to_numpy()
    assert 1.5 < np.abs(torque).max() <= 2.0
    angle = simulate(truth, command=torque, dt=0.01)[:-1, 0]
    noisy = angle + 1e-4 * np.random.default_rng(0).standard_normal(angle.size)
    found = fit(
        Log.from_arrays(time=plan["time"].to_numpy(), torque=torque, angle=noisy),
        ServoModel(effects=(CoulombFriction(torque=0.1),)),
    )
    assert found.model.values == pytest.approx(truth.values, rel=0.02)


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"speed": 1.0}, "travel, speed and acceleration"),
        ({"torque": 1.0, "speed": 1.0}, "the torque alone"),
        ({}, "travel, speed and acceleration"),
        ({"torque": -1.0}, "torque must be a positive number"),
        ({"travel": (1.0, 0.0), "speed": 1.0, "acceleration": 1.0}, "from a lower to a higher"),
    ],
)
def test_limits_that_are_none_are_refused(limits, message):
    with pytest.raises(BadParameter, match=message):
        DriveLimits(**limits)


def test_a_rate_that_cannot_follow_is_refused():
    for rate in (0.0, 5.0):
        with pytest.raises(BadParameter, match="rate"):
            first_experiment(ARM, rate=rate)


def test_the_command_writes_the_plan(tmp_path):
    out = tmp_path / "experiment.csv"
    words = ("plan", "--limits", "travel=-1:1,speed=5,acceleration=50", "--rate", 100, "--out", out)
    result = antidrive(*words)
    assert result.code == 0, result.err
    assert result.out.startswith("chirp: ")
    assert "Units: time s, setpoint rad, velocity rad/s, acceleration rad/s^2;" in result.out
    assert "Warning" not in result.out
    table = pd.read_csv(out)
    assert table["setpoint"].to_numpy() == pytest.approx(first_experiment(ARM, rate=100.0)["setpoint"].to_numpy())
    reported = json.loads(antidrive(*words, "--json").out)
    assert reported["duration"] == pytest.approx(len(table) / 100.0)


def test_a_plan_of_more_than_an_hour_is_warned_of(tmp_path):
    words = ("plan", "--limits", "travel=0:100,speed=0.1,acceleration=1", "--rate", 20, "--out", tmp_path / "plan.csv")
    spoken = antidrive(*words)
    assert spoken.code == 0, spoken.err
    hours = json.loads(antidrive(*words, "--json").out)["duration"] / 3600.0
    assert hours > 1.0
    assert f"Total: {hours:.2g} h, in the column setpoint." in spoken.out
    assert "Warning: this takes more than an hour; plan for a part of the travel" in spoken.out


@pytest.mark.parametrize(
    "limits", ["speed", "speed=fast", "travel=1,speed=1,acceleration=1", "torque=1,torque=2", "torque=-1"]
)
def test_the_command_reports_what_is_wrong(limits, tmp_path):
    result = antidrive("plan", "--limits", limits, "--out", tmp_path / "out" / "plan.csv")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert "imits" in result.err
    assert not (tmp_path / "out").exists()
