"""The lag of a sensor: exact behind a load that is accelerated, and no cause where it only mends an observer."""

from typing import Any

import numpy as np
import pytest
from hidden_effects import CASES
from machine import Machine, excitation, load_fluctuation, record

from diagnosis import diagnose
from identification.log import Log
from plant import ServoModel
from plant.effects import SensorLag
from plant.simulation import simulate

LEFT_OUT = next(case for case in CASES if case.effect == "end_stop")
FASTEST = 80.0  # of an observer, at 5 ms [rad/s]


def log_of(machine: Machine, seed: int, **how: Any) -> Log:
    return record(machine, excitation(2 * seed, duration=30.0), seed=seed, **how).log()


@pytest.mark.parametrize("time_constant", [0.002, 0.007, 0.02, 0.3])
def test_a_reading_behind_a_lag_is_exact_under_a_steady_torque(time_constant: float) -> None:
    """T y' = x - y behind x = a t^2 / 2, at samples longer and shorter than the lag."""
    dt, acceleration, load = 0.02, 40.0, ServoModel(inertia=0.05, gravity=0.0, viscous_friction=0.0)
    model = load.with_effect(SensorLag(time_constant=time_constant))
    t = dt * np.arange(11)
    states = simulate(model, command=np.full(10, load.inertia * acceleration), dt=dt)
    gone = time_constant * (1.0 - np.exp(-t / time_constant))
    exact = acceleration * (0.5 * t**2 - time_constant * (t - gone))
    assert states[:, 2] == pytest.approx(exact, abs=1e-12)


@pytest.mark.parametrize("h", [0.0, 1e-16, 1e-15, 1e-14, 1e-12])
def test_a_step_of_almost_no_length_keeps_the_measurement(h: float) -> None:
    """As a switch of a delayed command leaves one: the way is rounding, which the lag over the step would magnify."""
    rng = np.random.default_rng(0)
    for x, v in rng.uniform(-50.0, 50.0, size=(500, 2)):
        state, after = x - 0.007 * v, x + h * v
        shown = float(SensorLag(time_constant=0.007).advance_sensor(state, x, (x + after) / 2.0, after, h))
        assert shown == pytest.approx(state + h * v, abs=1e-10)


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
