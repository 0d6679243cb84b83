"""A log whose clock had run for long: drift and waves count from the log's own start, files keep their clock."""

import numpy as np
import pytest
from front_door import antidrive, write_model
from machine import Machine, excitation, record

from diagnosis import diagnose
from identification.log import Log
from plant import ServoModel

LONG_AGO = 1.6e9  # s, on a clock that counts from 1970


def at_clock(machine: Machine, start: float, duration: float = 30.0) -> Log:
    (run,) = record(machine, excitation(7, duration=duration), seed=3, noise=1e-3).log().runs
    return Log.from_arrays(time=start + run.time, torque=run.command, angle=run.output)


def test_time_counts_from_the_logs_start_and_the_start_is_kept():
    late, early = at_clock(Machine(), LONG_AGO), at_clock(Machine(), 0.0)
    assert late.runs[0].zero == LONG_AGO
    np.testing.assert_allclose(late.runs[0].time, early.runs[0].time, atol=1e-6)
    assert early.runs[0].zero == 0.0


def test_a_log_that_begins_a_little_late_keeps_its_time():
    log = at_clock(Machine(), 5.0)
    assert (log.runs[0].zero, log.runs[0].time[0]) == (0.0, 5.0)


def test_runs_of_one_recording_have_one_zero():
    (run,) = at_clock(Machine(), LONG_AGO, duration=20.0).runs
    time = LONG_AGO + run.time
    whole = Log.from_arrays(time=time, torque=run.command, angle=run.output, run=(run.time > 10.0).astype(int))
    first, second = whole.runs
    assert first.zero == second.zero == LONG_AGO
    assert second.time[0] == pytest.approx(10.0, abs=0.01)


@pytest.mark.parametrize("start", [0.0, LONG_AGO])
def test_a_wave_in_time_is_named_whatever_the_clock_shows(start):
    machine = Machine().hiding(periodic_disturbance={"amplitude": 0.08, "frequency": 1.7, "phase": 0.3})
    found = diagnose(at_clock(machine, start), candidates=["periodic_disturbance", "cogging", "friction_drift"])
    (cause,) = found.causes
    assert cause.effect == "periodic_disturbance"
    assert cause.parameters["frequency"].value == pytest.approx(1.7, rel=1e-3)
    assert cause.parameters["phase"].value == pytest.approx(0.3, abs=0.2)
    assert "from 21 s on" in "".join(found.warnings)


def test_a_late_clock_does_not_turn_friction_into_drift():
    log = at_clock(Machine().hiding(coulomb_friction={"torque": 0.3}), 2000.0)
    found = diagnose(log, candidates=["coulomb_friction", "friction_drift"])
    assert [cause.effect for cause in found.causes] == ["coulomb_friction"]
    assert found.causes[0].probability > 0.99


def test_predictions_carry_the_times_of_the_file(tmp_path):
    (run,) = at_clock(Machine(), 0.0, duration=10.0).runs
    log = tmp_path / "log.csv"
    stamps = [f"{LONG_AGO + t:.3f}" for t in run.time]
    rows = [f"{t},{u!r},{y!r}" for t, u, y in zip(stamps, run.command.tolist(), run.output.tolist(), strict=True)]
    log.write_text("\n".join(["time,torque,angle", *rows]) + "\n")
    out = tmp_path / "predicted.csv"
    model = write_model(tmp_path / "model.json", ServoModel.paper())
    assert antidrive("predict", model, log, "--out", out, "--quiet").code == 0
    times = [line.split(",")[1] for line in out.read_text().splitlines()[1:]]
    np.testing.assert_allclose([float(t) for t in times], [float(t) for t in stamps], atol=1e-6)
