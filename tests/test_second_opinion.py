"""What held-out data would have otherwise is said beside the diagnosis, and changes nothing in it."""

import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis import diagnose
from diagnosis.second_opinion import second_opinions
from identification.fit import fit
from identification.log import Log
from plant import ServoModel
from plant.effects import CoulombFriction


def log_of(machine: Machine, seed: int, duration: float = 20.0) -> Log:
    return record(machine, excitation(seed, duration=duration), seed=seed, noise=1e-3).log()


def rubbing(torque: float) -> Machine:
    return Machine().hiding(coulomb_friction={"torque": torque})


@pytest.fixture(scope="module")
def fitted():
    return fit(log_of(rubbing(0.3), 1), ServoModel.paper().with_effect(CoulombFriction(torque=0.2)))


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_the_same_machine_has_nothing_to_add(fitted, seed):
    assert second_opinions(fitted, log_of(rubbing(0.3), seed)) == ()


def test_a_machine_that_changed_says_what_did(fitted):
    (opinion,) = second_opinions(fitted, log_of(rubbing(0.6), 2))
    assert opinion.parameter == "coulomb_friction.torque"
    assert opinion.value == pytest.approx(0.3, abs=0.02)
    assert opinion.held_out_value == pytest.approx(0.6, abs=0.02)
    assert f"instead of {opinion.value:.4g}" in str(opinion)


@pytest.mark.parametrize(("swing", "noise", "known"), [(0.3, 0.05, True), (0.2, 1e-3, False)])
def test_a_log_that_excites_more_tells_what_the_first_could_not(swing, noise, known):
    torque = swing * np.sin(np.arange(0.0, 10.0, 0.005)) + (0.55 if known else 0.0)  # the latter within the dead zone
    base = fit(record(Machine(gravity=0.0), torque, seed=1, noise=noise).log(), ServoModel.paper())
    told = {opinion.parameter: opinion for opinion in second_opinions(base, log_of(Machine(gravity=0.0), 2))}
    inertia = told["inertia"]
    assert inertia.held_out_value == pytest.approx(2.0, abs=5.0 * inertia.held_out_std)
    assert (inertia.value is not None) == known
    assert ("cannot tell" in str(inertia)) != known


def test_a_diagnosis_says_it_and_does_not_heed_it():
    log = log_of(rubbing(0.3), 1)
    asked = ["coulomb_friction"]
    same = diagnose(log, None, log_of(rubbing(0.3), 2), candidates=asked)
    other = diagnose(log, None, log_of(rubbing(0.6), 2), candidates=asked)
    assert not any("held-out data alone" in warning for warning in same.warnings)
    assert any("coulomb_friction.torque 0.6" in warning for warning in other.warnings)
    np.testing.assert_array_equal(same.model.values, other.model.values)
