"""A load that wanders at random is noise and not a cause, and does not hide one."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from machine import Machine, excitation, load_fluctuation, record
from scipy.linalg import solve_discrete_are

from diagnosis import Diagnosis, diagnose, random_walk_load
from diagnosis.model_probability import CLEAR, NONE
from diagnosis.random_walk_load import with_lower_probability, without_random_walk_artefacts
from diagnosis.stepwise_round import Addition
from identification.fit import base_model, fit
from identification.log import Log
from identification.observer_gain import observer_gain
from identification.problem import Problem
from plant import Effect, ServoModel
from plant.effects import CoulombFriction, GravityOffset, TorqueOffset
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


def test_a_simulation_does_not_wander():
    assert observer_gain(0.0, np.full(3, DT), random_walk=True) == pytest.approx(np.zeros((3, 3)))


def test_an_observer_that_knows_of_wandering_predicts_it_better():
    log = log_with_random_walk(Machine(), 5000)
    found = fit(log)
    followed = Problem.of(log, base_model(log).with_effect(RandomWalkLoad())).descend(found)
    assert followed.log_likelihood > found.log_likelihood + 10.0


def is_said_to_wander(found: Diagnosis) -> bool:
    return any("a random-walk disturbance torque explains as much" in warning for warning in found.warnings)


def test_a_wandering_load_has_no_cause():
    """This one was imitated by five names together, each of them 1.000."""
    found = diagnose(log_with_random_walk(Machine(), 10005))
    assert found.verdict == "nothing_missing"
    assert is_said_to_wander(found) == any(candidate.probability > CLEAR for candidate in found.candidates)


@pytest.mark.parametrize("seed", [5002])
def test_a_cause_is_named_beside_a_wandering_load(seed):
    found = diagnose(log_with_random_walk(Machine().hiding(coulomb_friction={"torque": 0.1}), seed))
    assert [cause.effect for cause in found.causes] == ["coulomb_friction"]
    assert found.causes[0].parameters["torque"].value == pytest.approx(0.1, rel=0.1)


def test_a_name_has_to_beat_a_wandering_load():
    """A slow load of 0.01 N m that looks like a soft stop on this log: without the wandering it would be sure."""
    found = diagnose(log_with_random_walk(Machine(), 7001), candidates=["end_stop", "torque_offset"])
    assert max(found.candidates, key=lambda candidate: candidate.probability).probability > 0.999
    assert found.verdict == "nothing_missing"
    assert is_said_to_wander(found)


RUBS, PUSHES, TURNS = CoulombFriction(torque=0.1), TorqueOffset(torque=0.1), GravityOffset(beta=0.1)


@dataclass(frozen=True, eq=False)
class Fitted:
    """What is asked of a fit."""

    model: ServoModel
    log_likelihood: float
    bandwidth: float
    log: Any = field(default_factory=lambda: SimpleNamespace(sample_time=DT))
    held_log_likelihood: float | None = None


def fitted(model: ServoModel, log_likelihood: float, bandwidth: float = 2.0) -> Any:
    return Fitted(model, log_likelihood, bandwidth)


def addition(effect: Effect, fit: Any, evidence: float, none: float = 0.0) -> Addition:
    """Found with that evidence; visible by as much as the likelihood rises."""
    rival: Any = SimpleNamespace(
        effect=effect, visible=lambda fit, less, evidence: fit.log_likelihood - less.log_likelihood
    )
    odds = {effect.name: 0.9 - none, "cogging": 0.1, NONE: none}
    return Addition(effect=effect.name, fit=fit, odds=odds, evidence=evidence, contest=(rival,))


def test_the_weaker_of_two_replaceable_effects_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    """And then the stronger has to stay: wandering cannot stand for both."""
    worth = {("torque_offset",): 0.1, ("coulomb_friction",): 0.1, (): 50.0}

    def near(_: Any, model: ServoModel) -> Any:
        left = tuple(effect.name for effect in model.effects if effect.name != "random_walk_load")
        return fitted(model, 100.0 - worth.get(left, 0.0))

    monkeypatch.setattr(random_walk_load, "fitted_near", near)
    model = ServoModel()
    both = fitted(model.with_effect(RUBS).with_effect(PUSHES), 100.0)
    additions = [addition(PUSHES, both, evidence=20.0), addition(RUBS, both, evidence=5.0)]
    (kept,) = without_random_walk_artefacts(fitted(model, 0.0), additions, None)
    assert kept.effect == "torque_offset"
    assert [effect.name for effect in kept.fit.model.effects] == ["torque_offset"]  # and no load that wanders


@pytest.mark.parametrize(
    ("by_the_estimate", "with_what_is_open", "names"),
    [(170.0, 1.0, []), (170.0, -1.0, [RUBS, PUSHES, TURNS]), (160.0, 1.0, [RUBS, PUSHES, TURNS])],
)
def test_effects_that_stop_explaining_are_dropped(
    monkeypatch: pytest.MonkeyPatch, by_the_estimate: float, with_what_is_open: float, names: list[Effect]
) -> None:
    """They explain 165 more than a slow observer did, and leave it nothing."""
    base = fitted(ServoModel(), 0.0, 5.0)
    model = ServoModel().with_effect(RUBS).with_effect(PUSHES).with_effect(TURNS)
    final = fitted(model, 165.0, 0.0)
    additions = [addition(effect, final, evidence=50.0) for effect in (RUBS, PUSHES, TURNS)]
    monkeypatch.setattr(random_walk_load, "evidence_of", lambda at, than: at.log_likelihood - than.log_likelihood)
    monkeypatch.setattr(
        random_walk_load, "log_likelihood_by_sample", lambda at, _: np.array([by_the_estimate if at is base else 0.0])
    )
    monkeypatch.setattr(random_walk_load, "predictive_loss", lambda *_: with_what_is_open)
    kept = without_random_walk_artefacts(base, additions, None)
    assert [one.effect for one in kept] == [effect.name for effect in names]


@pytest.mark.parametrize("bandwidth", [0.0, 0.1 / DT])
def test_coloured_noise_is_not_tried_where_it_cannot_show(monkeypatch: pytest.MonkeyPatch, bandwidth: float) -> None:
    monkeypatch.setattr(random_walk_load, "fitted_near", None)
    final = fitted(ServoModel().with_effect(RUBS), 100.0, bandwidth)
    additions = [addition(RUBS, final, evidence=20.0)]
    assert without_random_walk_artefacts(fitted(ServoModel(), 0.0, bandwidth), additions, None) is additions


def test_the_odds_among_names_stay_and_those_against_none_fall() -> None:
    found = addition(RUBS, None, evidence=20.0, none=0.02)
    assert with_lower_probability(found, 0.99) is found
    odds = with_lower_probability(found, 0.49).odds
    assert odds == pytest.approx({NONE: 0.51, "coulomb_friction": 0.44, "cogging": 0.05})
    assert list(odds) == [NONE, "coulomb_friction", "cogging"]  # the likeliest first
