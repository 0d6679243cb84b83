"""A log whose torque was measured behind a filter: what acts is ahead of it, and only the log is late."""

from __future__ import annotations

import numpy as np
import pytest
from machine import Follower, Machine, record, wandering_reference

from diagnosis import diagnose
from diagnosis.explanation.summary import headline
from identification import Log, fit
from mpc import Controller
from plant import BadParameter, GearTrain, ServoModel, catalogue, simulate
from plant.linear import linearise
from plant.measured_torque import supporting_points
from plant.servo_fmu import servo_fmu
from plant.urdf import urdf

LAG = 0.012
HOST = Machine(inertia=1.5, effects={})


def loop_log(seed: int, **effects: dict[str, float]) -> Log:
    """A loop that follows a random-walk reference."""
    reference = wandering_reference(seed, duration=20.0)
    return record(HOST.hiding(**effects), Follower(reference=reference), seed=seed, noise=2e-4).log()


@pytest.fixture(scope="module")
def measured() -> Log:
    return loop_log(5, torque_measurement_lag={"time_constant": LAG}, coulomb_friction={"torque": 0.4})


def test_lines_between_supporting_points_keep_the_torque() -> None:
    for share in (0.02, 0.05, 0.1):  # of the sampling frequency
        torque = np.cos(2.0 * np.pi * share * np.arange(400))
        straight = np.sinc(share) ** 2 * np.ptp(supporting_points(torque)[1:-1]) / np.ptp(torque)
        assert straight == pytest.approx(1.0, abs=0.5 * (2.0 * np.pi * share) ** 4 / 100 + 1e-3)


def test_a_fit_finds_the_lag_and_with_it_the_inertia(measured: Log) -> None:
    friction = catalogue["coulomb_friction"](torque=0.3)
    late = ServoModel(effects=(friction, catalogue["torque_measurement_lag"](time_constant=0.005)))
    found, without = fit(measured, late), fit(measured, late.without_effect("torque_measurement_lag"))
    # a torque that is held over each sample acts later than lines between them, by a twelfth of Ts^2 over the lag
    assert found["torque_measurement_lag.time_constant"].value == pytest.approx(LAG, rel=0.03)
    assert found["inertia"].value == pytest.approx(1.5, rel=1e-3)
    assert found["coulomb_friction.torque"].value == pytest.approx(0.4, rel=0.01)
    assert abs(without["inertia"].value - 1.5) > 5.0 * abs(found["inertia"].value - 1.5)


def test_the_diagnosis_reads_the_torque_as_measured(measured: Log) -> None:
    found = diagnose(measured)
    assert {cause.effect for cause in found.causes} == {"torque_measurement_lag", "coulomb_friction"}
    assert found.verdict == "named"
    assert found.to_dict()["data"]["read_as"] == "measured"
    late = "The torque of this log was measured, and its measurement is late."
    assert headline(found) == f"{late} The model lacks Coulomb friction."


def test_the_command_of_a_loop_is_read_as_one() -> None:
    found = diagnose(loop_log(4, coulomb_friction={"torque": 0.4}))
    assert {cause.effect for cause in found.causes} == {"coulomb_friction"}
    assert found.to_dict()["data"]["read_as"] == "command"


def test_a_lag_behind_what_was_measured_is_part_of_it(measured: Log) -> None:
    """Of a drive's own lags and limits the measured torque already tells, so no such name stands beside it."""
    upstream = set(catalogue["torque_measurement_lag"].measured)
    for explained in diagnose(measured).sets:
        assert "torque_measurement_lag" not in explained.effects or not upstream & set(explained.effects)


def test_the_machine_itself_has_no_such_lag() -> None:
    machine = ServoModel.paper()
    late = machine.with_effect(catalogue["torque_measurement_lag"](time_constant=LAG))
    assert late.without_clock() == late.commanded() == machine
    assert urdf(late).left_out == urdf(machine).left_out
    assert servo_fmu(late, sample_time=0.005).source == servo_fmu(machine, sample_time=0.005).source
    gears, rate = GearTrain.paper(), 0.005
    assert Controller(late, gears, sample_time=rate).model == Controller(machine, gears, sample_time=rate).model
    plain = machine.without_effect("dead_zone")
    seen, same = (linearise(m, sample_time=0.005) for m in (plain, late.without_effect("dead_zone")))
    assert np.array_equal(seen.A, same.A)
    assert np.array_equal(seen.B, same.B)


def test_a_torque_that_is_not_late_is_that_of_its_samples() -> None:
    """A constant acts as it is, whatever the lag."""
    plain = ServoModel(inertia=1.5, gravity=0.0, viscous_friction=0.2)
    late = plain.with_effect(catalogue["torque_measurement_lag"](time_constant=LAG))
    command = np.full(100, 0.7)
    assert simulate(late, command=command, dt=0.005) == pytest.approx(simulate(plain, command=command, dt=0.005))


def test_a_delay_beside_a_measured_torque_is_refused() -> None:
    late = catalogue["torque_measurement_lag"](time_constant=LAG)
    with pytest.raises(BadParameter, match="input_delay cannot stand beside torque_measurement_lag"):
        ServoModel(effects=(late, catalogue["input_delay"](time=0.01)))


def test_a_negative_lag_is_refused() -> None:
    with pytest.raises(BadParameter, match="time_constant"):
        catalogue["torque_measurement_lag"](time_constant=-0.001)
