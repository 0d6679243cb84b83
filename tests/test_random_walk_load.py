"""A random-walk disturbance torque is noise and not a cause, and does not hide one."""

import numpy as np
import pytest
from machine import Machine, excitation, load_fluctuation, record
from scipy.linalg import solve_discrete_are

from diagnosis import diagnose
from identification.fit import base_model, fit
from identification.log import Log
from identification.observer_gain import observer_gain
from identification.problem import Problem
from plant.effects.random_walk_load import RandomWalkLoad

DT, DURATION = 0.005, 30.0


def log_with_random_walk(machine: Machine, seed: int) -> Log:
    """A torque of 0.01 N m rms that keeps its value for about 5 s."""
    load = load_fluctuation(seed, 0.01, (round(DURATION / DT), 1), correlation_time=5.0)
    commands = excitation(2 * seed, duration=DURATION, sample_time=DT)
    return record(machine, commands, seed=seed, sample_time=DT, noise=1e-3, load_torque=load).log()


@pytest.mark.parametrize("bandwidth", [1.0, 20.0, 300.0])
def test_the_gain_is_the_stationary_kalman_filters(bandwidth):
    """Of a load whose acceleration makes a random step each sample, from the Riccati equation."""
    F = np.array([[1.0, DT, DT**2 / 2.0], [0.0, 1.0, DT], [0.0, 0.0, 1.0]])
    pushed, H = np.array([[DT**2 / 2.0], [DT], [1.0]]), np.array([[1.0, 0.0, 0.0]])
    step = (bandwidth * DT) ** 3 / DT**2  # over measurement noise of one
    P = solve_discrete_are(F.T, H.T, step**2 * pushed @ pushed.T, np.eye(1))
    expected = (P @ H.T / (H @ P @ H.T + 1.0)).ravel()
    assert observer_gain(bandwidth, np.array([DT]), random_walk=True)[:, 0] == pytest.approx(expected, rel=1e-6)


def test_a_simulation_has_no_random_walk():
    assert observer_gain(0.0, np.full(3, DT), random_walk=True) == pytest.approx(np.zeros((3, 3)))


def test_an_observer_with_a_random_walk_predicts_it_better():
    log = log_with_random_walk(Machine(), 5000)
    found = fit(log)
    followed = Problem.of(log, base_model(log).with_effect(RandomWalkLoad())).descend(found)
    assert followed.log_likelihood > found.log_likelihood + 10.0


@pytest.mark.parametrize("seed", [5000, pytest.param(10005, marks=pytest.mark.long)])
def test_a_random_walk_load_has_no_cause(seed):
    """The last was imitated by five names together, each of them 1.000."""
    found = diagnose(log_with_random_walk(Machine(), seed))
    assert found.verdict in ("nothing_missing", "unknown")
    assert found.causes == ()


@pytest.mark.parametrize("seed", [5002])
def test_a_cause_is_named_beside_a_random_walk_load(seed):
    found = diagnose(log_with_random_walk(Machine().hiding(coulomb_friction={"torque": 0.1}), seed))
    assert [cause.effect for cause in found.causes] == ["coulomb_friction"]
    assert found.causes[0].parameters["torque"].value == pytest.approx(0.1, rel=0.1)


def test_an_effect_has_to_exceed_a_random_walk_load():
    """A slow load of 0.01 N m that looks like a soft stop on this log: without the wandering it would be sure."""
    found = diagnose(log_with_random_walk(Machine(), 7001), candidates=["end_stop", "torque_offset"])
    assert found.verdict in ("nothing_missing", "unknown")
    assert found.causes == ()
