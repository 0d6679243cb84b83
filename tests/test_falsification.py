"""What is not told, which part is held out, how numbers are put, and what is said of the motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from front_door import columns

from diagnosis.explanation.wording import change, percent
from diagnosis.measured_motion import MeasuredMotion, measurement_noise
from diagnosis.validation_split import parts, split
from identification import Log, Unidentifiable

LOG = Log.from_arrays(**columns())  # its torque is 2 N m at most


def test_a_rise_is_reported_by_one_figure():
    assert change(1.0 - np.sqrt(500.0)) == "22 times"
    assert percent(3.2, 0.1) == "320 ± 10 %"
    assert change(-0.3) == "30 %"
    assert change(0.3) == "30 %"
    assert percent(21.71) == "22 times"
    assert percent(float("nan")) == "not measured"
    assert percent(1.0) == "> 99.9 %"


def with_rest(after: int) -> Log:
    """The log with the load at rest after it."""
    (run,) = LOG.runs
    still = {"command": 0.0, "output": run.output[-1], "valid": True, "servo_gain": 0.0}
    longer = {name: np.append(getattr(run, name), np.full(after, value)) for name, value in still.items()}
    return replace(LOG, runs=(replace(run, time=0.01 * np.arange(len(run) + after), **longer),))


def test_the_held_out_part_moves_like_the_rest():
    kept, held, sentence = split(LOG)
    assert sentence.startswith("Validation data: the last 30 % of the only run, from 8.4 s on")
    kept, held, sentence = split(with_rest(900))
    assert "standstill at its ends is left out" in sentence
    assert kept.runs[0].duration + held.runs[0].duration < 12.3
    assert held.runs[0].duration == pytest.approx(3.4, abs=0.4)
    assert np.ptp(held.runs[0].output) > 0.1 * np.ptp(LOG.runs[0].output)


def test_a_motion_too_short_to_be_divided_is_refused():
    run = with_rest(900).runs[0]
    with pytest.raises(Unidentifiable, match=r"The load moves in \d+ samples of this log only"):
        split(replace(LOG, runs=(run.slice(len(run) - 940, None),)))


def test_runs_that_stand_still_are_not_held_out():
    still = replace(LOG.runs[0], output=np.full(len(LOG.runs[0]), 0.3), label="still")
    log = replace(LOG, runs=(LOG.runs[0], LOG.runs[0], still))
    kept, held, _ = split(log)
    assert still not in held.runs
    assert len(kept.runs) == 2
    _, held, notes = parts(LOG, replace(LOG, runs=(still,)))
    assert held.runs[0].label.endswith("from 8.4 s")
    assert notes[0].startswith(
        "The load stands still in that part, so another part is used for validation. Validation data:"
    )
    _, held, notes = parts(LOG, replace(LOG, runs=(LOG.runs[0], still)))
    assert held.runs == (LOG.runs[0],)
    assert notes == ["The held-out part stands still in still, which is left out."]


def test_the_motion_is_reported_as_the_sensor_saw_it():
    time, rng = 0.01 * np.arange(3000), np.random.default_rng(0)
    staircase = np.repeat([16.0, 31.0, 47.0, 63.0, 79.0, 94.0, 110.0, 126.0, 63.0, 31.0], 300)

    def moved(speed) -> MeasuredMotion:
        noise = 1e-4 * rng.standard_normal(3000)
        return MeasuredMotion.of(Log.from_arrays(time=time, torque=0.1 * speed, angle=np.cumsum(speed) * 0.01 + noise))

    rising = moved(staircase)
    assert rising.viscous() is None  # many speeds
    assert rising.inertia() is None
    assert rising.dry() == "the load never turns back"
    prbs = moved(np.convolve(np.repeat(rng.choice([-150.0, 150.0], 300), 10), np.ones(8) / 8, "same"))
    assert (prbs.dry(), prbs.inertia(), prbs.zone()) == (None, None, None)
    steady = moved(np.full(3000, 3.0))
    assert steady.viscous() == "the load moves at one speed only"
    assert steady.inertia() == "the load hardly speeds up"
    assert steady.breakaway("rad/s") == "the load is never slower than 3 rad/s"


def test_the_noise_of_the_reading_holds_no_motion():
    assert measurement_noise(LOG.runs[0]) == pytest.approx(1e-4, rel=0.2)
