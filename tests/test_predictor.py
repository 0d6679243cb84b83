"""What a prediction is given: delayed commands, a gain for each time step, and nothing of a masked sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.observer_gain import observer_gain
from identification.predictor import Predictor, run_inputs
from identification.run import Run
from plant import ServoModel
from plant.discrete import INPUTS
from plant.effects import InputDelay, SetpointRateLimit

COMMAND, PREVIOUS, MEASURED, GAINS = 0, 1, len(INPUTS), slice(len(INPUTS) + 1, None)


def run_of(count: int = 12, **channels: np.ndarray) -> Run:
    given: dict[str, np.ndarray] = {
        "time": 0.01 * np.arange(count),
        "command": 1.0 + np.arange(count),
        "output": 0.1 * np.arange(count),
        "valid": np.ones(count, dtype=bool),
        "servo_gain": np.zeros(count),
    }
    return Run(label="a run", number=0, **(given | channels))


@pytest.mark.parametrize(("first", "last"), [(0, 12), (0, 2), (2, 6), (6, 12)])
def test_a_command_comes_late_by_whole_samples_and_a_part_of_one(first: int, last: int) -> None:
    model = ServoModel.paper().with_effect(InputDelay(time=0.034))
    rows, values = run_inputs(run_of(), model, model.values, 5.0, 0.0, slice(first, last))
    now = np.arange(first, last)
    assert rows[:, COMMAND] == pytest.approx(1.0 + np.maximum(now - 3, 0))
    assert rows[:, PREVIOUS] == pytest.approx(1.0 + np.maximum(now - 4, 0))
    assert rows[:, MEASURED] == pytest.approx(0.1 * now)
    assert values[model.names.index("input_delay.time")] == pytest.approx(0.004)
    assert model.values[model.names.index("input_delay.time")] == 0.034


def test_each_time_step_has_its_own_gain() -> None:
    run = run_of(time=np.cumsum([0.0, *[0.01] * 5, *[0.02] * 6]))
    rows, _ = run_inputs(run, ServoModel.paper(), ServoModel.paper().values, 5.0, 0.0, slice(0, 12))
    gains = rows[:, GAINS].T
    assert gains == pytest.approx(observer_gain(5.0, np.append(np.diff(run.time), 0.02)))
    assert len(np.unique(gains[0])) == 2


def test_a_prediction_sees_nothing_of_a_masked_sample() -> None:
    valid = np.arange(12) != 5
    model, initial = ServoModel.paper(), np.array([[0.0, 10.0]])
    found = []
    for shown in (0.5, 90.0):
        run = run_of(valid=valid, output=np.where(valid, 0.1 * np.arange(12), shown))
        predictor = Predictor(model=model, runs=(run,), free=(0,))
        found += predictor.predict(model.values, initial, bandwidth=50.0, width=0.0)
    assert found[0].errors[5] == 0.0
    assert found[0].errors[6] != 0.0
    assert np.array_equal(found[0].states, found[1].states)
    assert np.array_equal(found[0].jacobian, found[1].jacobian)


def test_a_prediction_begins_at_the_first_set_point() -> None:
    gain = np.where(np.arange(12) < 4, 0.0, 8.0)
    run = run_of(servo_gain=gain, command=gain * 0.7, output=np.zeros(12))
    model = ServoModel.paper().with_effect(SetpointRateLimit(rate=5.0))
    for run_at, goal in ((run, 0.7), (replace(run, servo_gain=np.zeros(12)), 0.0)):
        predictor = Predictor(model=model, runs=(run_at,), free=())
        (found,) = predictor.predict(model.values, np.zeros((1, 2)), bandwidth=0.0, width=0.0)
        assert found.states[model.states.index("setpoint_rate_limit"), 0] == pytest.approx(goal)


def test_masked_samples_count_for_nothing_even_in_an_overflow() -> None:
    model = ServoModel.paper()
    runaway = model.values
    runaway[model.names.index("viscous_friction")] = -1e6 * runaway[model.names.index("inertia")]
    count = 400
    run = run_of(count, valid=np.arange(count) < 300)
    predictor = Predictor(model=model, runs=(run,), free=(0,))
    (found,) = predictor.predict(runaway, np.array([[0.0, 10.0]]), bandwidth=0.0, width=0.0)
    assert not np.isfinite(found.errors[299])
    assert not found.errors[300:].any()
    assert not found.jacobian[300:].any()
