"""What `antidrive diagnose` leaves behind when a log cannot tell two causes apart."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from front_door import antidrive
from machine import Machine, excitation, record


@pytest.mark.long
def test_an_ambiguous_log_gets_the_experiment_that_settles_it(tmp_path) -> None:
    late = record(Machine().hiding(input_delay={"time": 0.0012}), excitation(1, duration=12.0))
    columns = {"time": late.time, "torque": late.command[:, 0], "angle": late.measured[:, 0]}
    pd.DataFrame(columns).to_csv(tmp_path / "log.csv", index=False)
    out = tmp_path / "out"
    result = antidrive("diagnose", tmp_path / "log.csv", "--out", out)
    assert result.code == 0, result.err
    found = json.loads((out / "diagnosis.json").read_text())
    assert found["verdict"] == "ambiguous"
    named = found["causes"][0]
    entry = found["separating_experiment"]
    assert entry["rivals"] == [named["effect"], named["alternatives"][0]["effect"]]
    assert entry["expected_log_odds"] > entry["chirp_log_odds"]
    played = pd.read_csv(out / entry["file"])
    assert list(played.columns) == ["time", "torque"]
    assert np.ptp(played["time"]) + entry["sample_time"] == pytest.approx(entry["duration"])
    assert played["torque"].abs().max() <= np.abs(columns["torque"]).max()
    assert entry["file"] in result.out


def test_a_clear_log_gets_none(tmp_path) -> None:
    rubbing = record(Machine().hiding(coulomb_friction={"torque": 0.2}), excitation(1, duration=12.0))
    columns = {"time": rubbing.time, "torque": rubbing.command[:, 0], "angle": rubbing.measured[:, 0]}
    pd.DataFrame(columns).to_csv(tmp_path / "log.csv", index=False)
    out = tmp_path / "out"
    assert antidrive("diagnose", tmp_path / "log.csv", "--out", out).code == 0
    assert json.loads((out / "diagnosis.json").read_text())["separating_experiment"] is None
    assert not list(out.glob("*.csv"))
