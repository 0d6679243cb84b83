"""A lag of the sensor that only mends the observer behind which a poor model follows its log is no cause."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hidden_effects import CASES
from machine import Machine, excitation, load_fluctuation, record
from scipy.signal import lfilter

from diagnosis import diagnose
from diagnosis.sensor_filters import whitened_rise
from identification.log import Log

LEFT_OUT = next(case for case in CASES if case.effect == "end_stop")
FASTEST = 80.0  # of an observer, at 5 ms [rad/s]


def log_of(machine: Machine, seed: int, **how: Any) -> Log:
    return record(machine, excitation(2 * seed, duration=30.0), seed=seed, **how).log()


def left(innovations: Any) -> Any:
    return SimpleNamespace(innovations=innovations, samples=innovations.size)


def test_what_a_filter_explains_is_no_evidence() -> None:
    white = np.random.default_rng(1).standard_normal(4000)
    coloured = lfilter([1.0], [1.0, 0.5], white)
    rise = 0.5 * white.size * np.log(np.mean(coloured**2) / np.mean(white**2))
    assert rise > 500.0  # by which the model that leaves white noise is likelier
    assert abs(whitened_rise(left(white), left(coloured))) < 5.0
    assert whitened_rise(left(0.9 * white), left(white)) == pytest.approx(-white.size * np.log(0.9))


@pytest.mark.parametrize("seed", [25000, 28000])
def test_a_stop_that_nobody_knows_is_no_lag_of_the_sensor(seed: int) -> None:
    """Once it was with certainty: behind the observer that the stop asks for, all the rest was filtered badly."""
    log = log_of(LEFT_OUT.machine(LEFT_OUT.sizes[-1]), seed)
    found = diagnose(log, None, log_of(LEFT_OUT.machine(LEFT_OUT.sizes[-1]), seed + 1), candidates=["sensor_lag"])
    assert found.base.bandwidth > 0.5 * FASTEST
    assert max(candidate.probability for candidate in found.candidates) > 0.99
    assert (found.verdict, found.causes) == ("unknown", ())
    assert any("Sensor lag is rejected: it only changes the observer" in warning for warning in found.warnings)


def test_a_lag_of_the_sensor_is_named_behind_such_an_observer() -> None:
    """A load that fluctuates by 1 N m asks for one as well, and no filter makes up for 20 ms."""
    machine, shape = Machine().hiding(sensor_lag={"time_constant": 0.02}), (6000, 1)
    log, held_out = (log_of(machine, seed, load_torque=load_fluctuation(seed, 1.0, shape)) for seed in (1, 2))
    found = diagnose(log, None, held_out, candidates=["sensor_lag"])
    assert found.base.bandwidth > 0.5 * FASTEST
    (cause,) = found.causes
    assert cause.effect == "sensor_lag"
    assert cause.parameters["time_constant"].value == pytest.approx(0.02, rel=0.15)
