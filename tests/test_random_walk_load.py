"""A random-walk disturbance torque is noise and not a cause, and does not hide one."""

import pytest
from machine import Machine, excitation, load_fluctuation, record

from diagnosis import diagnose
from identification.log import Log

DT, DURATION = 0.005, 30.0


def log_with_random_walk(machine: Machine, seed: int) -> Log:
    """A torque of 0.01 N m rms that keeps its value for about 5 s."""
    load = load_fluctuation(seed, 0.01, (round(DURATION / DT), 1), correlation_time=5.0)
    commands = excitation(2 * seed, duration=DURATION, sample_time=DT)
    return record(machine, commands, seed=seed, sample_time=DT, noise=1e-3, load_torque=load).log()


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
