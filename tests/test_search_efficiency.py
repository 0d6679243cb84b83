"""What is not done twice, nor in vain: the same answers with fewer and faster passes over a log."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis.nuisance import Nuisance
from identification.fit import base_model, fit
from identification.fit_result import Fit
from identification.predictor import Prediction
from identification.problem import Problem, first_states
from plant.recursion import Recursion


@pytest.fixture(scope="module")
def lacking() -> Fit:
    log = record(Machine().hiding(coulomb_friction={"torque": 0.2}), excitation(1, duration=10.0), noise=1e-3).log()
    return fit(log)


def test_of_a_colour_that_does_not_pay_no_fit_is_made(lacking: Fit) -> None:
    problem = Problem.of(lacking.log, lacking.model)
    found = problem.recoloured(lacking)
    assert found is not None
    assert problem.recoloured(lacking, found.log_likelihood - 1e-6) is not None
    assert problem.recoloured(lacking, found.log_likelihood + 1.0) is None


def test_a_long_log_started_from_parts_gives_the_same_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    from identification import problem

    log = record(Machine(), excitation(1, duration=20.0), seed=1, noise=1e-3).log()
    whole = Problem.of(log, base_model(log)).solve()
    monkeypatch.setattr(problem, "_PARTS", 4)
    monkeypatch.setattr(problem, "_PART", 500)
    (run,), parts = log.runs, problem._parts(log).runs
    assert [len(part) for part in parts] == [500] * 4
    assert parts[-1].time[-1] > 0.8 * run.time[-1]
    again = Problem.of(log, base_model(log)).solve()
    assert again.model.values == pytest.approx(whole.model.values, rel=1e-3)


def test_decaying_values_reach_zero_before_denormals() -> None:
    state, row = ca.SX.sym("state"), ca.SX.sym("row")
    fading = Recursion(lambda: ca.Function("fading", [state, row], [0.1 * state + row, state]), carried=1)
    rows = np.zeros((1001, 1))
    rows[0] = 1.0
    _, (slow,) = fading([np.zeros(1)], rows)
    assert slow[150, 0] == pytest.approx(1e-149)
    assert not slow[152:].any()
    if fading.wait():
        _, (fast,) = fading([np.zeros(1)], rows)
        np.testing.assert_array_equal(fast, slow)


def test_slopes_behind_an_observer_are_numbers_or_zero() -> None:
    log = record(Machine(), excitation(1, duration=60.0), seed=1, noise=1e-3).log()
    problem = Problem.of(log, base_model(log))
    ((_, *_, last),) = [
        list(problem.predictor.pieces(problem.model.values, first_states(log), bandwidth=30.0, width=0.0))
    ]
    by_initial_state = last[1].jacobian[:, -2:]
    assert not by_initial_state.any()


@pytest.mark.parametrize("runs", [1, 3])
def test_products_of_what_is_beyond_need_no_projection(runs: int) -> None:
    rng = np.random.default_rng(runs)

    def prediction(samples: int) -> Prediction:
        return Prediction(
            errors=np.zeros(samples),
            innovations=rng.normal(size=samples),
            jacobian=rng.normal(size=(samples, 5)),
            states=np.zeros((2, samples)),
            output=np.zeros(samples),
        )

    several = [prediction(40 + 10 * run) for run in range(runs)]
    nuisance = Nuisance.of(several)
    free = np.vstack([p.jacobian[:, :3] for p in several])
    columns = np.column_stack((rng.normal(size=(len(free), 3)), free @ [1.0, -2.0, 0.5]))
    values = nuisance.beyond(rng.normal(size=len(free)))
    beyond = nuisance.beyond(columns)
    information, pull = nuisance.information(columns, values)
    assert information[:3, :3] == pytest.approx(beyond[:, :3].T @ beyond[:, :3], rel=1e-12, abs=1e-12)
    assert pull[:3] == pytest.approx(beyond[:, :3].T @ values, rel=1e-12, abs=1e-12)
    assert not information[3].any()  # what the parameters can follow is no regressor, not even by rounding
    columns[:, 1] = 1e200  # grown behind an observer that is too slow
    grown, pulled = nuisance.information(columns, values)
    kept = [0, 2]
    assert grown[np.ix_(kept, kept)] == pytest.approx(information[np.ix_(kept, kept)])
    assert pulled[kept] == pytest.approx(pull[kept])
    assert not grown[1].any()
    assert pulled[1] == 0.0
    assert pull[3] == 0.0
