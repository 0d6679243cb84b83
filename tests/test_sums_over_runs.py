"""Sums over runs and pieces against the whole Jacobian written out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from machine import Machine, excitation, record

from identification.fit import fit
from identification.log import Log
from identification.noise import colour, colouring
from identification.observer_steps import ObserverSteps
from identification.predictor import PIECE, Prediction
from identification.problem import Problem
from identification.sums_over_runs import informations, normal_equations
from plant import ServoModel
from plant.effects import InputDelay


def dense(predictions: Sequence[Prediction]) -> np.ndarray:
    """(T, F + 2R) Jacobian of all runs."""
    free = predictions[0].jacobian.shape[1] - 2
    rows = []
    for place, p in enumerate(predictions):
        row = np.zeros((p.innovations.size, free + 2 * len(predictions)))
        row[:, :free], row[:, free + 2 * place : free + 2 * place + 2] = p.jacobian[:, :free], p.jacobian[:, free:]
        rows.append(row)
    return np.vstack(rows)


def some(samples: int, seed: int) -> Prediction:
    rng = np.random.default_rng(seed)
    noise = colour(rng.normal(size=samples), np.array([0.6]))
    return Prediction(
        errors=noise,
        innovations=noise,
        jacobian=rng.normal(size=(samples, 5)),
        states=np.zeros((2, samples)),
        output=np.zeros(samples),
    )


def test_normal_equations_of_pieces_are_those_of_the_whole() -> None:
    runs = [some(300, seed) for seed in range(3)]
    pieces = [(k, part) for k, run in enumerate(runs) for part in (cut(run, 0, 120), cut(run, 120, 300))]
    found = normal_equations(pieces, 3)
    jacobian, residuals = dense(runs), np.concatenate([run.innovations for run in runs])
    assert found.cost == pytest.approx(residuals @ residuals, rel=1e-12)
    assert found.gradient == pytest.approx(jacobian.T @ residuals, rel=1e-10, abs=1e-10)
    assert found.information == pytest.approx(jacobian.T @ jacobian, rel=1e-10, abs=1e-10)


def cut(run: Prediction, first: int, last: int) -> Prediction:
    return replace(run, innovations=run.innovations[first:last], jacobian=run.jacobian[first:last])


def test_a_piece_that_overflowed_costs_everything() -> None:
    broken = replace(some(50, 0), innovations=np.full(50, 1e200))
    assert normal_equations([(0, some(50, 1)), (1, broken)], 2).cost == np.inf


def test_the_colour_of_noise_ends_where_a_run_does() -> None:
    runs = [some(400, seed) for seed in range(2)]
    white, coloured = informations(runs)
    jacobian = dense(runs)
    coefficients, variance = colouring(np.concatenate([run.innovations for run in runs]))
    answers = [colour(np.eye(400), coefficients) for _ in runs]
    covariance = np.zeros((800, 800))
    for k, answer in enumerate(answers):
        covariance[400 * k : 400 * (k + 1), 400 * k : 400 * (k + 1)] = variance * answer @ answer.T
    assert white == pytest.approx(jacobian.T @ jacobian, rel=1e-10, abs=1e-10)
    assert coloured == pytest.approx(jacobian.T @ covariance @ jacobian, rel=1e-9, abs=1e-9)


@pytest.fixture(scope="module")
def long() -> Log:
    commands = excitation(3, duration=0.005 * (2 * PIECE + 500))
    log = record(Machine().hiding(input_delay={"time": 0.0123}), commands).log()
    valid = np.ones(len(log.runs[0]), dtype=bool)
    valid[PIECE - 30 : PIECE + 5] = False
    return replace(log, runs=(replace(log.runs[0], valid=valid),))


def test_a_run_in_pieces_is_the_run_in_one(long: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    model = ServoModel.paper().with_effect(InputDelay(time=0.012))
    problem, initial = Problem.of(long, model), np.array([[0.01, -0.02]])
    in_pieces = list(problem.predictor.pieces(model.values, initial, bandwidth=5.0, width=0.0))
    assert [piece.innovations.size for _, piece in in_pieces] == [PIECE, PIECE, 500]
    (joined,) = problem.predictor.predict(model.values, initial, bandwidth=5.0, width=0.0)
    monkeypatch.setattr("identification.predictor.PIECE", 10**9)
    (whole,) = problem.predictor.predict(model.values, initial, bandwidth=5.0, width=0.0)
    for name in ("innovations", "jacobian", "states", "output"):
        assert np.array_equal(getattr(joined, name), getattr(whole, name))
    assert not joined.innovations[PIECE - 30 : PIECE + 5].any()


def test_a_cost_above_the_limit_ends_the_prediction(long: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = Problem.of(long, ServoModel.paper())
    point = problem.pack(problem.model.values, np.array([[0.01, -0.02]]))
    whole = problem.linearise(point, 5.0, 0.0)
    same = problem.linearise(point, 5.0, 0.0, most=1.01 * whole.cost)
    assert same.cost == whole.cost
    assert np.array_equal(same.information, whole.information)
    monkeypatch.setattr(ObserverSteps, "sensitivities", None)
    assert problem.linearise(point, 5.0, 0.0, most=0.99 * whole.cost).cost == np.inf


def test_equal_runs_share_their_information() -> None:
    out = record(Machine(), np.column_stack([excitation(seed, duration=12.0) for seed in (1, 2)]))
    alone = fit(out.log(0), ServoModel.paper())
    both = fit(out.log_of_runs(), ServoModel.paper())
    assert both["inertia"].std < alone["inertia"].std
    assert both["inertia"].value == pytest.approx(2.0, abs=5 * both["inertia"].std)
