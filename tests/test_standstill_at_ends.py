"""Rest at the ends of a log and runs of nothing else: left out with a word; what rest tells is kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sample_logs import motion

from identification.errors import MalformedLog
from identification.log import Log

CASES = Path(__file__).parents[1].parent / "shared" / "cases" / "logs"
DT = 0.005
MOVING = {name: values for name, values in motion(samples=2000, dt=DT).items() if name in ("torque", "angle")}
NOISE = np.random.default_rng(3).normal(size=(2, 20_000))


def joined(*parts, noise=0.0):
    """Stretches one after the other: seconds of rest, or the motion (None); the load rests where it is."""
    torque, angle = np.empty(0), np.full(1, MOVING["angle"][0])
    for rest in parts:
        count = len(MOVING["angle"]) if rest is None else round(rest / DT)
        torque = np.append(torque, MOVING["torque"] if rest is None else np.zeros(count))
        angle = np.append(angle, MOVING["angle"] if rest is None else np.full(count, angle[-1]))
    count = len(torque)
    return {
        "time": DT * np.arange(count),
        "torque": torque + noise * np.std(MOVING["torque"]) * NOISE[0, :count],
        "angle": angle[1:] + noise * NOISE[1, :count],
    }


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_rest_at_both_ends_is_cut_to_a_bit(noise):
    log = Log.from_arrays(**joined(12.0, None, 12.0, noise=noise))
    (run,) = log.runs
    assert run.time[0] == pytest.approx(11.0, abs=0.1)
    assert run.time[-1] == pytest.approx(23.0, abs=0.1)
    (repair,) = log.repairs
    assert "arrays: the first 11 s and the last 11 s" in repair
    assert "are left out, as neither 'torque' nor 'angle' changes there" in repair


def test_a_shorter_rest_and_one_between_motions_stay():
    columns = joined(2.0, None, 15.0, None, 2.0)
    log = Log.from_arrays(**columns)
    assert len(log.runs[0]) == len(columns["time"])
    assert log.repairs == ()


@pytest.mark.parametrize("end", ["torque", "angle"])
def test_what_changes_in_one_channel_is_no_rest(end):
    columns = joined(None, 10.0)
    columns[end][2000:] += 0.3 * np.sin(np.arange(2000) * 0.01) * np.std(columns[end])
    assert len(Log.from_arrays(**columns).runs[0]) == 4000


def test_a_flickering_encoder_rests():
    columns = joined(None, 10.0)
    columns["angle"] = np.round(columns["angle"] / 1e-3 + 0.8 * NOISE[0, :4000]) * 1e-3
    assert len(Log.from_arrays(**columns).runs[0]) == pytest.approx(2200, abs=20)


def test_standstill_runs_are_cut_unless_a_torque_holds_the_load():
    columns = joined(None, 10.0, None)
    columns["torque"][3000:4000] = columns["torque"].max()
    columns["run"] = np.repeat(["up", "off", "held", "down"], [2000, 1000, 1000, 2000])
    log = Log.from_arrays(**columns)
    assert [run.run for run in log.runs] == ["up", "held", "down"]
    assert log.repairs == ("arrays run off: left out, as neither 'torque' nor the load moves in it",)


def test_rest_under_a_torque_may_last_as_long_as_the_motion():
    columns = joined(None, 30.0)
    columns["torque"][2000:] = columns["torque"].max()
    assert Log.from_arrays(**columns).runs[0].time[-1] == pytest.approx(20.0, abs=0.1)


def test_a_log_of_rest_alone_is_refused():
    with pytest.raises(MalformedLog, match="record a log in which the drive moves the load"):
        Log.from_arrays(**joined(10.0))


def test_a_load_that_never_moves_under_torque_is_kept():
    columns = joined(None)
    log = Log.from_arrays(**columns | {"angle": 1e-4 * NOISE[0, :2000]})
    assert len(log.runs[0]) == 2000


@pytest.mark.skipif(not CASES.exists(), reason="the folder of other people's logs is not here")
def test_the_idle_tail_of_a_staircase_is_cut():
    log = Log.read(CASES / "05-staircase-idle-tail" / "log.csv")
    assert 36.0 < log.runs[0].time[-1] < 41.0
    assert any("the last 11" in repair for repair in log.repairs)
