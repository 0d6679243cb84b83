"""A lag of the sensor that only mends the observer behind which a poor model follows its log is no cause."""

from typing import Any

import pytest
from hidden_effects import CASES
from machine import Machine, excitation, load_fluctuation, record

from diagnosis import diagnose
from identification.log import Log

LEFT_OUT = next(case for case in CASES if case.effect == "end_stop")
FASTEST = 80.0  # of an observer, at 5 ms [rad/s]


def log_of(machine: Machine, seed: int, **how: Any) -> Log:
    return record(machine, excitation(2 * seed, duration=30.0), seed=seed, **how).log()


@pytest.mark.long
@pytest.mark.parametrize("seed", [25000, 28000])
def test_a_stop_that_nobody_knows_is_no_lag_of_the_sensor(seed: int) -> None:
    """Once it was with certainty: behind the observer that the stop asks for, all the rest was filtered badly."""
    log = log_of(LEFT_OUT.machine(LEFT_OUT.sizes[-1]), seed)
    found = diagnose(log, None, log_of(LEFT_OUT.machine(LEFT_OUT.sizes[-1]), seed + 1), candidates=["sensor_lag"])
    assert found.base.bandwidth > 0.5 * FASTEST
    assert found.verdict in ("unknown", "ambiguous")
    assert all(cause.probability < 0.9 for cause in found.causes)


def test_a_lag_of_the_sensor_is_named_behind_such_an_observer() -> None:
    """A load that fluctuates by 1 N m asks for one as well, and no filter makes up for 20 ms."""
    machine, shape = Machine().hiding(sensor_lag={"time_constant": 0.02}), (6000, 1)
    log, held_out = (log_of(machine, seed, load_torque=load_fluctuation(seed, 1.0, shape)) for seed in (1, 2))
    found = diagnose(log, None, held_out, candidates=["sensor_lag"])
    assert found.base.bandwidth > 0.5 * FASTEST
    (cause,) = found.causes
    assert cause.effect == "sensor_lag"
    assert cause.parameters["time_constant"].value == pytest.approx(0.02, rel=0.15)
