"""Dwell at reversals: what is counted, and that a planned preload makes it that of a machine without a gap."""

from __future__ import annotations

import json
import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from antidrive.cli import main
from antidrive.experiments.kinds import KINDS
from antidrive.experiments.reversal_dwell import ONE, PLANNED, Dwell, DwellSettings, dwell, experiment
from antidrive.experiments.settings import read_settings
from antidrive.scenario import scenario_text
from plant.errors import BadParameter

GAP = 3e-3
SHORT = {
    "frequencies = [0.05, 0.15, 0.3]": "frequencies = [0.1]",
    "[0.29e-3, 1.16e-3, 4.65e-3]": f"[{GAP}]",
    "[0.0, 0.06, 0.2]": "[0.0, 0.2]",
}


def short(changes: dict[str, str]) -> str:
    text = scenario_text("dwell")
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    return text


def settings() -> DwellSettings:
    made = read_settings(KINDS["reversal_dwell"].settings, "dwell", tomllib.loads(short(SHORT)))
    assert isinstance(made, DwellSettings)
    return made


@cache
def found() -> Dwell:
    return experiment(settings(), 0)


def place(strategy: str) -> int:
    return list(settings().strategies).index(strategy)


@given(st.lists(st.integers(-6, 6), min_size=1, max_size=40), st.integers(0, 8))
def test_dwell_is_the_longest_run_within_the_band(reading: list[int], band: int) -> None:
    values = np.array(reading, dtype=float)
    runs = [
        stop - start
        for start in range(len(values))
        for stop in range(start + 1, len(values) + 1)
        if np.ptp(values[start:stop]) <= band
    ]
    assert dwell(values, float(band)) == max(runs)


@pytest.mark.long
def test_a_reversal_has_dwell_without_any_backlash() -> None:
    t = np.arange(4000) * 0.005
    turning = 0.3 * (1 - np.cos(2 * np.pi * 0.05 * t))
    expected = 2 * np.sqrt(2 * 2e-4 / (0.3 * (2 * np.pi * 0.05) ** 2)) / 0.005  # x = a t^2/2 within the band
    assert dwell(turning, 2e-4) == pytest.approx(expected, abs=1.5)


@pytest.mark.long
def test_one_drive_stops_while_it_crosses_its_backlash() -> None:
    one = place(ONE)
    assert found().beyond_gapless[0, one, 0] > 10
    assert found().error[0, one, 1] > 3 * found().error[0, one, 0]


@pytest.mark.long
def test_planned_preload_looks_the_same_as_no_backlash() -> None:
    planned = place(PLANNED)
    assert abs(found().beyond_gapless[0, planned, 0]) <= 1
    assert found().error[0, planned, 1] == pytest.approx(found().error[0, planned, 0], rel=0.02)
    assert found().least[0, planned, 1] > 0.0
    kept, friction = 0.03 * 161 / 20, 5e-4 * 99.2307  # vibration takes some of it; friction is planned for at its worst
    assert 0.4 * kept < found().least[0, planned, 1] < kept + 2 * friction


@pytest.mark.long
def test_two_drives_without_preload_are_no_better_than_one() -> None:
    loose = place("both, no preload")
    assert found().beyond_gapless[0, loose, 0] > 10
    assert found().least[0, loose, 1] < 0.0


@pytest.mark.long
def test_more_constant_preload_than_enough_only_adds_copper_loss() -> None:
    much, none, planned = place("both, preload 0.2 N m"), place("both, no preload"), place(PLANNED)
    assert found().least[0, much, 1] > found().least[0, planned, 1] > 0.0
    assert abs(found().beyond_gapless[0, much, 0]) <= 1
    assert found().error[0, much, 1] == pytest.approx(found().error[0, planned, 1], rel=0.05)
    assert found().copper_loss[0, much, 1] == pytest.approx(2 * 0.2**2 + found().copper_loss[0, none, 1], rel=0.02)
    assert found().copper_loss[0, much, 1] > 5.0 * found().copper_loss[0, planned, 1]


@pytest.mark.long
def test_the_papers_35_and_12_are_counted(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["simulate", "figure7-samples", "--out", str(tmp_path / "out"), "--json"]) == 0
    cases = {case["strategy"]: case["dwell"] for case in json.loads(capsys.readouterr().out)["cases"]}
    assert cases[ONE][1] == pytest.approx(35, abs=1)
    assert cases[PLANNED][1] == pytest.approx(12, abs=1)
    assert cases[PLANNED][0] == pytest.approx(12, abs=1)  # no gap at all


def test_the_command_reports_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    quick = {**SHORT, "frequencies = [0.05, 0.15, 0.3]": "frequencies = [1.0]"}
    (tmp_path / "quick.toml").write_text(short(quick))
    assert main(["simulate", str(tmp_path / "quick.toml"), "--out", str(tmp_path / "out"), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert [case["strategy"] for case in summary["cases"]] == list(settings().strategies)
    assert summary["planned_contact_lost"] is False
    assert summary["planned_differs_at_most"] <= 1
    assert "Dwell is the greatest number of successive samples" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("band = 2e-4", "band = 0.0", "band"),
        ("preloads = [0.0,", "preloads = [-0.1,", "preloads"),
        ("[rig]", "[rig]\nbacklash = 1e-3", "backlash"),
        ("0.3]", "0.0]", "frequen"),
    ],
)
def test_a_bad_dwell_is_named(old: str, new: str, complaint: str) -> None:
    with pytest.raises(BadParameter, match=complaint):
        read_settings(KINDS["reversal_dwell"].settings, "dwell", tomllib.loads(short({old: new})))
