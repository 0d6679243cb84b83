"""The closed loops that come with the package: what each is for is a number of its summary and its page."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
import pytest
from front_door import antidrive

from diagnosis.explanation.wording import measured

LOOPS = ("tracking", "disturbance", *(pytest.param(name, marks=pytest.mark.long) for name in ("figure7", "drive-loss")))


@cache
def played(name: str) -> tuple[dict[str, Any], pd.DataFrame, str]:
    """Summary, trajectory and page that the command writes."""
    with TemporaryDirectory() as folder:
        result = antidrive("simulate", name, "--out", folder, "--quiet")
        assert result.code == 0, result.err
        out = Path(folder)
        summary = json.loads((out / "summary.json").read_text())
        return (
            summary,
            pd.read_csv(out / "trajectory.csv"),
            (out / "report.html").read_text().replace("\N{NO-BREAK SPACE}", " "),
        )


@pytest.mark.parametrize("name", LOOPS)
def test_tracking_keeps_contact_and_the_page_has_its_numbers(name: str) -> None:
    summary, path, page = played(name)
    error = path.angle - path.reference
    assert summary["tracking_rms"] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-6)
    assert summary["tracking_rms"] < (1.5e-4 if name == "drive-loss" else 1e-4)  # that has the slower default loop
    assert summary["largest_error"] < (4e-3 if name == "drive-loss" else 1e-3)
    assert 0.3 < summary["least_preload_margin"] / (0.02 * 161 / 20) < 1.0  # the rest is vibration and friction
    assert summary["degraded_samples"] == np.sum(path.status != "optimal")
    for number, unit in (("tracking_rms", "rad"), ("least_preload_margin", "N m")):
        assert measured(summary[number], summary["std"][number], unit) in page


@pytest.mark.long
def test_one_drive_crosses_its_backlash_at_reversals_two_do_not() -> None:
    summary, path, page = played("figure7")
    one = summary["single_drive"]
    alone = path.single_drive_angle - path.reference
    assert one["tracking_rms"] == pytest.approx(np.sqrt(np.mean(alone**2)), rel=1e-6)
    assert one["tracking_rms"] > 1.8 * summary["tracking_rms"]
    assert summary["samples_without_contact"] == 0
    assert one["samples_without_contact"] > 0.2 * summary["samples"]
    assert one["impact_on_opposite_flank"] > 10.0
    apart = measured(one["samples_without_contact"], summary["std"]["samples_without_contact_single_drive"])
    assert f"in {apart} samples with one" in page


def test_a_push_is_taken_up_while_it_lasts() -> None:
    summary, path, _ = played("disturbance")
    error, seen = path.angle - path.reference, path.disturbance_estimate
    calm, late = path.time.between(1.5, 1.99), path.time.between(4.0, 4.99)
    assert error[path.time.between(2.0, 2.5)].max() > 2e-4  # it does push
    assert abs(error[late].mean()) < 3e-5
    assert seen[late].mean() - seen[calm].mean() == pytest.approx(0.6, abs=0.02)
    assert abs(summary["final_error"]) < 3e-5


@pytest.mark.long
def test_the_drive_that_is_left_keeps_the_motion() -> None:
    summary, path, page = played("drive-loss")
    after = path.time >= 5.0
    assert (path.torque_2[after] == 0.0).all()
    known = path.time > 5.02 - 1e-9
    assert path.status[known].str.startswith("degraded: drive 2 is lost, and backlash control with it").all()
    assert (path.status[~known] == "optimal").all()
    assert summary["backlash_control"] == "lost"
    assert summary["contact_lost"] is True
    without = path.angle_without_loss - path.reference
    growth = np.std(path.angle[after] - path.reference[after]) / np.std(without[after])
    assert summary["error_growth"] == pytest.approx(growth, rel=0.05)
    assert 0.5 < summary["error_growth"] < 3.0
    assert "backlash control is lost" in page
