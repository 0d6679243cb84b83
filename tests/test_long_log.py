"""A log that is too long for the search is searched in stretches."""

from __future__ import annotations

import numpy as np
import pytest
from machine import Machine, excitation, record

from diagnosis import diagnose, long_log
from identification.log import Log


def test_short_logs_are_used_whole() -> None:
    log = record(Machine(), excitation(1, duration=5.0)).log()
    assert long_log.stretches(log) == (log, None)


def test_stretches_are_spread_over_all_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(long_log, "LONGEST", 1000)
    log = Log.merge([record(Machine(), excitation(k, duration=10.0), seed=k).log() for k in (1, 2)])
    short, notes = long_log.stretches(log)
    assert notes is not None
    assert notes.startswith("The log has 4,000 samples. ")
    assert 900 <= sum(map(len, short.runs)) <= 1000
    assert short.runs[0].time[0] == log.runs[0].time[0]
    assert short.runs[-1].time[-1] == log.runs[-1].time[-1]
    for run in short.runs:
        place = int(np.flatnonzero(log.runs[0].time == run.time[0])[0])
        assert any(np.array_equal(one.output[place : place + len(run)], run.output) for one in log.runs)


def test_an_effect_is_found_in_stretches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(long_log, "LONGEST", 2000)
    machine = Machine().hiding(coulomb_friction={"torque": 0.4})
    log = record(machine, excitation(3, duration=30.0), seed=3).log()
    found = diagnose(log, candidates=["coulomb_friction", "torque_offset"])
    assert [cause.effect for cause in found.causes] == ["coulomb_friction"]
    assert any(warning.startswith("The log has 4,200 samples. 5 stretches") for warning in found.warnings)
    assert found.base.samples == 2000
