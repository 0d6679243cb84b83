"""The linearised predictor against the recursion written out, the predictor itself, and its own adjoint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from machine import Machine, excitation, load_fluctuation, record

from diagnosis.linear import AT_ONCE, Linear, follow, linearised
from identification.fit import fit
from identification.log import Log
from identification.problem import Problem
from plant import ServoModel
from plant.effects import TorqueOffset

COLOURS = [(), (0.8, -0.1)]


def random_linear(samples: int, n: int, colour: tuple[float, ...] = ()) -> Linear:
    rng = np.random.default_rng(samples)
    return Linear(
        closed_loop=0.4 * rng.normal(size=(samples, n, n)),
        by_torque=rng.normal(size=(samples, n)),
        by_measurement=rng.normal(size=(samples, n)),
        seen=rng.normal(size=(samples, n)),
        weight=(rng.random(samples) > 0.1).astype(float),
        colour=colour,
    )


@pytest.mark.parametrize("samples", [1, 2, 50, 997, 9000])
def test_columns_side_by_side_follow_the_recursion(samples: int) -> None:
    rng, linear = np.random.default_rng(1), random_linear(samples, 3)
    columns = rng.normal(size=(samples, 2))
    state, seen = np.zeros((3, 2)), []
    for k in range(samples):
        seen.append(linear.seen[k] @ state)
        state = linear.closed_loop[k] @ state + np.outer(linear.by_torque[k], columns[k])
    found = follow(linear.closed_loop, linear.by_torque, linear.seen, columns)
    assert found == pytest.approx(np.array(seen), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("on_measurement", [False, True])
@pytest.mark.parametrize("columns", [1, AT_ONCE, 2 * AT_ONCE + 3])
def test_torques_and_readings_of_any_number_keep_their_places(columns: int, on_measurement: bool) -> None:
    linear, rng = random_linear(60, 2), np.random.default_rng(4)
    inputs = rng.normal(size=(60, columns))
    together = linear.response(inputs, on_measurement=on_measurement)
    alone = [linear.response(inputs[:, [k]], on_measurement=on_measurement)[:, 0] for k in range(columns)]
    assert together == pytest.approx(np.array(alone).T, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("colour", COLOURS)
@pytest.mark.parametrize("on_measurement", [False, True])
def test_the_score_is_the_adjoint_of_the_response(on_measurement: bool, colour: tuple[float, ...]) -> None:
    linear, rng = random_linear(400, 3, colour), np.random.default_rng(2)
    innovations, column = rng.normal(size=400), rng.normal(size=(400, 1))
    along = -innovations @ linear.response(column, on_measurement=on_measurement)[:, 0]
    assert linear.score(innovations[:, None])[int(on_measurement)][:, 0] @ column[:, 0] == pytest.approx(
        along, rel=1e-12
    )


def predicted_and_seen(
    log: Log, model: ServoModel, initial: np.ndarray, bandwidth: float
) -> tuple[np.ndarray, np.ndarray]:
    """(T,) response of the innovations to a constant torque: of the linearised predictor, and by differences."""
    size = 1e-6

    def innovations(offset: float) -> np.ndarray:
        pushed = model.with_effect(TorqueOffset(torque=offset))
        predictor = Problem.of(log, pushed).predictor
        return predictor.predict(pushed.values, initial, bandwidth=bandwidth, width=0.0)[0].innovations

    (run,), predictor = log.runs, Problem.of(log, model).predictor
    path = predictor.predict(model.values, initial, bandwidth=bandwidth, width=0.0)[0]
    linear = linearised(model, run, path, bandwidth, substeps=predictor.substeps, colour=log.colour)
    predicted = linear.response(np.ones((len(run), 1)))[:, 0]
    return predicted, (innovations(size) - innovations(-size)) / (2 * size)


@pytest.mark.parametrize("colour", COLOURS)
def test_constant_torque_response_equals_a_predicted_offset(colour: tuple[float, ...]) -> None:
    command = excitation(3, duration=10.0)
    log = record(Machine(), command, load_torque=load_fluctuation(1, 0.05, (command.size, 1))).log()
    found = fit(log, ServoModel.paper())
    assert found.bandwidth > 0.0  # so that the observer's corrections are in it
    predicted, seen = predicted_and_seen(replace(log, colour=colour), found.model, found.initial, found.bandwidth)
    assert predicted == pytest.approx(seen, abs=1e-4 * np.abs(seen).max())


@pytest.mark.parametrize("colour", COLOURS)
def test_an_extension_that_removes_the_observer_is_accepted(colour: tuple[float, ...]) -> None:
    """Corrections of half a radian: with gravity, which bends with the angle, the place makes the slope."""
    log = record(Machine(gravity=40.0), excitation(3, duration=5.0), noise=0.5).log()
    model = ServoModel(inertia=2.0, gravity=40.0, viscous_friction=0.8)
    predicted, seen = predicted_and_seen(replace(log, colour=colour), model, np.zeros((1, 2)), 20.0)
    assert predicted == pytest.approx(seen, abs=1e-5 * np.abs(seen).max())
