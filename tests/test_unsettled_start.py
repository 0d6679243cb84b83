"""Hidden initial states: fitted where a run was cut out of a motion, settled where it begins at rest."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from diagnosis.evidence.marginal import families_along
from diagnosis.evidence.set_likelihood import SetLikelihood
from diagnosis.falsification import _squared_innovations
from identification import fit, unsettled_start
from identification.fit_result import Fit
from identification.log import Log
from identification.problem import Problem, first_states
from identification.simulation import free_simulation
from identification.standard_errors import fit_with_errors
from identification.unsettled_start import unsettled_if_shown
from plant import ServoModel, simulate
from plant.effects import ActuatorLag, Backlash, Compliance, SensorLag

DT, NOISE = 0.01, 1e-4
RIGID = ServoModel(inertia=2.0, gravity=0.5, viscous_friction=3.0)
LAGGED = replace(RIGID, effects=(ActuatorLag(time_constant=0.2),))
SLOW = replace(RIGID, effects=(SensorLag(time_constant=0.2),))
WOUND = replace(RIGID, effects=(Compliance(frequency=12.0, damping=0.03, motor_share=0.3),))


def cut(truth: ServoModel, first: int, *, runs: int = 1) -> tuple[Log, np.ndarray]:
    """A log that begins at a sample of a motion from rest, and the true states."""
    time = np.arange(1500) * DT
    rng = np.random.default_rng(3)
    tables, states = [], []
    for run in range(runs):
        torque = 4.0 * np.sin(2 * np.pi * (0.5 + 0.2 * run) * time) + 2.0 * np.sign(np.sin(2 * np.pi * 0.31 * time))
        states = simulate(truth, command=torque, dt=DT)
        shown = states[:-1, -1] if truth.holds("sensor_lag") else states[:-1, 0]
        angle = shown + NOISE * rng.standard_normal(time.size)
        tables.append({"time": time[first:] - time[first], "torque": torque[first:], "angle": angle[first:]})
    logs = [Log.from_arrays(**table) for table in tables]
    return replace(logs[0], runs=tuple(log.runs[0] for log in logs)), np.asarray(states[first:-1])


def fitted(log: Log, truth: ServoModel) -> Fit:
    return fit(log, truth)


@pytest.mark.parametrize("truth", [LAGGED, SLOW, WOUND], ids=["lag", "sensor", "shaft"])
def test_the_states_behind_a_cut_are_found(truth: ServoModel) -> None:
    log, states = cut(truth, 333)
    found = fitted(log, truth)
    assert found.log.unsettled
    assert found.noise_std == pytest.approx(NOISE, rel=0.1)
    for line, true in zip(found.parameters, truth.values, strict=True):
        assert line.std is not None
        assert abs(line.value - true) < 4.0 * line.std
    predictor = Problem.of(found.log, found.model).predictor
    settled = predictor.settled(found.log.runs[0], found.model.values, found.initial[0])
    begun = settled[2:] + found.initial[0, 2:]
    assert np.abs(states[0, 2:] - settled[2:]).max() > 0.02  # it does matter
    np.testing.assert_allclose(begun, states[0, 2:], rtol=0.05, atol=0.01)


@pytest.mark.parametrize("truth", [LAGGED, SLOW, WOUND], ids=["lag", "sensor", "shaft"])
def test_a_run_from_rest_begins_settled(truth: ServoModel) -> None:
    found = fitted(cut(truth, 0)[0], truth)
    assert not found.log.unsettled
    assert found.initial.shape == (1, 2)


def test_a_rigid_body_has_no_hidden_start() -> None:
    found = fitted(cut(RIGID, 333)[0], RIGID)
    assert not found.log.unsettled


def test_a_lag_before_a_backlash_has_its_hidden_start() -> None:
    gap = Backlash(gap=0.02, motor_share=0.4)
    both = replace(LAGGED, effects=(*LAGGED.effects, gap))
    log, _ = cut(both, 333)
    problem = Problem.of(log, both, fixed=both.names)
    settled = problem.minimise(problem.pack(both.values, first_states(log)), 5.0, 0.0)
    free, best = unsettled_if_shown(problem, settled, 5.0)
    assert free.predictor.fitted_starts == (0, 1, both.states.index("actuator_lag"))
    _, initial = free.unpack(best.point)
    assert initial[0, 2] < -0.1  # the other flank is touched at the start, which is not fitted
    assert not initial[0, 3:].any()


def test_every_run_has_its_own_hidden_start() -> None:
    log, _ = cut(LAGGED, 333, runs=2)
    found = fitted(log, LAGGED)
    assert found.initial.shape == (2, 3)
    assert abs(found.initial[0, 2] - found.initial[1, 2]) > 0.1
    apart = fit(log, LAGGED, per_run=["inertia"])
    assert [apart[f"inertia[{run.label}]"].value for run in log.runs] == pytest.approx([2.0, 2.0], rel=0.01)


def test_a_simulation_of_a_cut_log_finds_its_start() -> None:
    log, _ = cut(LAGGED, 333)
    (simulated,) = free_simulation(log, LAGGED)
    error = np.sqrt(np.mean((simulated - log.runs[0].output) ** 2))
    assert error < 1e-3  # 0.019 with a settled lag


def test_states_go_by_name_to_another_model() -> None:
    found = fitted(cut(LAGGED, 333)[0], LAGGED)
    both = replace(RIGID, effects=(*SLOW.effects, *LAGGED.effects))
    assert found.initial_of(both)[0, both.states.index("actuator_lag")] == found.initial[0, 2]
    assert found.initial_of(both)[0, both.states.index("sensor_lag")] == 0.0
    np.testing.assert_array_equal(found.initial_of(RIGID), found.initial[:, :2])


def test_hidden_starts_that_nothing_shows_cost_evidence() -> None:
    log, _ = cut(LAGGED, 0)
    settled = fitted(log, LAGGED)
    problem = Problem.of(replace(settled.log, unsettled=True), settled.model)
    best = problem.minimise(problem.pack(settled.model.values, settled.initial), settled.bandwidth, 0.0)
    free = fit_with_errors(problem, settled.bandwidth, best, 0)
    families = families_along(settled)
    assert families is not None
    likelihoods = [SetLikelihood.at(each, ["actuator_lag"], families) for each in (settled, free)]
    less = [each.log_likelihood for each in likelihoods if each is not None]
    assert less[0] - less[1] == pytest.approx(0.5 * np.log(settled.samples), abs=2.0)


def test_validation_data_may_begin_in_motion() -> None:
    found = fitted(cut(LAGGED, 0)[0], LAGGED)
    squares = _squared_innovations(cut(LAGGED, 333)[0], found, 1.0)
    assert np.mean(squares[:30]) < 3.0 * np.mean(squares[30:])


def test_a_start_from_which_the_motion_explodes_is_no_overflow() -> None:
    """The squares of its change are beyond the largest number; it explains nothing of the noise."""
    noise, ramp = np.random.default_rng(0).standard_normal(200), np.linspace(1e180, 1e200, 200)

    def predict(values: np.ndarray, begun: np.ndarray, **_: object) -> list[SimpleNamespace]:
        moved = float(np.any(begun != 0.0))
        return [SimpleNamespace(innovations=noise + moved * ramp, states=np.ones((2, 200)) * np.arange(200))]

    predictor = SimpleNamespace(predict=predict, fitted_starts=(0,))
    free = SimpleNamespace(predictor=predictor, model=SimpleNamespace(states=("angle", "velocity")))
    cost = unsettled_start._promised(free, np.zeros(1), np.zeros((1, 2)), 0.0)  # type: ignore[arg-type]
    assert cost == pytest.approx(float(noise @ noise), rel=0.05)
