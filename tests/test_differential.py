"""Identification in differential and common mode, on the rig: gaps within 5 % over all sizes and encoders."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from antidrive.cli import main
from antidrive.experiments.differential import DifferentialSettings
from antidrive.experiments.settings import read_settings
from antidrive.html_page import printed
from antidrive.scenario import scenario_text
from identification import Log, lost_motion
from plant.errors import BadParameter
from plant.gears import GearTrain

ARCMIN = np.pi / 180 / 60


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("differential")
    assert main(["simulate", "differential", "--out", str(out), "--quiet"]) == 0
    return out


@pytest.fixture(scope="module")
def summary(folder: Path) -> Any:
    return json.loads((folder / "summary.json").read_text())


@pytest.mark.long
def test_backlash_is_within_5_percent_with_every_encoder(summary: Any) -> None:
    cases = summary["cases"]
    assert {case["bits"] for case in cases} == {17, 20, 23}
    assert np.ptp([case["gap"] / ARCMIN for case in cases]) == pytest.approx(19.9, abs=0.02)
    assert min(case["gap"] for case in cases) == pytest.approx(0.1 * ARCMIN, rel=1e-3)
    for case in cases:
        for gap in case["gaps"]:
            assert gap["value"] == pytest.approx(case["gap"], rel=0.05)
            assert abs(gap["value"] - case["gap"]) < 3.5 * gap["std"] < 0.065 * case["gap"]
        assert case["total_gap"]["value"] == pytest.approx(2 * case["gap"], rel=1e-3)
    assert summary["all_within_5_percent"] is True
    assert 0.3 < summary["root_mean_square_score"] < 1.6


@pytest.mark.long
def test_a_load_that_stands_leaves_17_bits_less_certain(summary: Any) -> None:
    def std(cases: Any) -> float:
        return max(case["gaps"][0]["std"] for case in cases if case["bits"] == 17 and case["gap"] < 0.11 * ARCMIN)

    assert std(summary["standing"]) > 1.3 * std(summary["cases"])
    for case in summary["standing"]:
        assert abs(case["gaps"][0]["value"] - case["gap"]) < 3.5 * case["gaps"][0]["std"]


@pytest.mark.long
def test_stiffness_and_load_dependent_friction_are_found(summary: Any) -> None:
    assert summary["stiffness"]["value"] == pytest.approx(2e4, rel=2e-3)
    assert summary["friction_coefficient"]["value"] == pytest.approx(0.05, rel=5e-3)
    damped = 5e-4 * 99.2307 + 6.0 * 7.4 / 2e4  # of the motor, and the damping of the teeth at the speed of the sweep
    assert summary["friction"]["value"] == pytest.approx(damped, abs=0.003)


@pytest.mark.long
def test_common_mode_moves_the_load_and_agrees_on_friction(summary: Any) -> None:
    common, ratio = summary["common_mode"], 99.2307
    assert common["inertia"] == pytest.approx([2.0 + 2 * 4e-6 * ratio**2] * 3, rel=0.01)
    assert common["gravity"] == pytest.approx([0.5] * 3, rel=0.02)
    assert common["viscous_friction"] == pytest.approx([0.8 + 2e-7 * ratio**2] * 3, rel=0.02)
    assert common["coulomb_friction.torque"] == pytest.approx(summary["friction_by_differential_mode"], rel=0.02)
    assert np.polyfit(summary["preloads"], common["coulomb_friction.torque"], 1)[0] == pytest.approx(0.1, rel=0.05)


@pytest.mark.long
def test_the_trajectory_is_a_log_of_its_own(folder: Path, summary: Any) -> None:
    gears = GearTrain.paper()
    log = Log.read(folder / "trajectory.csv", gears=gears)
    found, case = lost_motion(log, gears), summary["cases"][7]
    for drive, expected in zip(found.drives, case["gaps"], strict=True):
        assert drive.gap.value == pytest.approx(expected["value"], rel=1e-3)
    assert drive.gap.value == pytest.approx(case["gap"], rel=0.05)


@pytest.mark.long
def test_the_page_reports_it(folder: Path, summary: Any) -> None:
    page = (folder / "report.html").read_text()
    assert page.count('class="plot"') == 3
    assert printed(f"an error of {100 * summary['largest_relative_error']:.2g} % at most") in page


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("visits = 20", "visits = 2", "visits"),
        ("bits = [17, 20, 23]", "bits = [17.5]", "bits"),
        ("greatest_preload = 8.0", "greatest_preload = 0.7", "greatest_preload"),
        ("preloads = [3.0, 5.5, 8.0]", "preloads = [1.0]", "preloads"),
        ("[rig]", "[rig]\nbacklash = 1e-3", "backlash"),
        ("0.291e-4", "-0.291e-4", "gaps"),
    ],
)
def test_a_bad_sweep_is_named(old: str, new: str, complaint: str) -> None:
    text = scenario_text("differential")
    assert old in text
    with pytest.raises(BadParameter, match=complaint):
        read_settings(DifferentialSettings, "differential", tomllib.loads(text.replace(old, new)))
