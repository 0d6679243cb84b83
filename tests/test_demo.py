"""The demo tells the truth: what it says was missing is what was hidden, and its gains are gains."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from front_door import antidrive, listing

from antidrive.demo import HIDDEN
from identification import fit, log_of
from plant import read_model
from plant.gears import GearTrain


@pytest.fixture(scope="module")
def demo_run(tmp_path_factory):
    out = tmp_path_factory.mktemp("demo") / "out"
    return antidrive("demo", "--out", out), out


def test_names_what_was_hidden_and_gains_by_it(demo_run):
    result, out = demo_run
    assert result.code == 0, result.err
    summary = json.loads((out / "summary.json").read_text())
    assert summary["synthetic"] is True
    assert summary["verdict"] == "named"
    assert sorted(summary["missing"]) == ["cogging", "coulomb_friction"]
    assert summary["prediction"]["rms_after"] < 0.3 * summary["prediction"]["rms_before"]
    assert summary["tracking"]["rms_after"] < 0.8 * summary["tracking"]["rms_before"]
    assert summary["least_preload_margin"] > 0
    causes = {cause["effect"]: cause for cause in json.loads((out / "diagnosis.json").read_text())["causes"]}
    cogging = causes["cogging"]["parameters"]
    assert cogging["amplitude"]["value"] == pytest.approx(HIDDEN["cogging_amplitude"], rel=0.05)
    motors = 2 * 5e-4 * GearTrain.paper().ratio  # dry friction of both, seen from the load
    friction = causes["coulomb_friction"]["parameters"]["torque"]["value"]
    assert friction == pytest.approx(HIDDEN["coulomb_friction"] + motors, rel=0.02)
    assert cogging["order"]["value"] == pytest.approx(HIDDEN["cogging_order"], rel=0.01)


def test_ends_as_in_the_readme(demo_run):
    result, _ = demo_run
    readme = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"```text\n(Synthetic.*?)```", readme, re.DOTALL)
    number = re.compile(r"(?<![\w.])\d+(?:\.\d+)?")
    ends = result.out[: result.out.index("Written to")]
    assert number.sub("#", ends) == number.sub("#", shown)
    here, there = ([float(n) for n in number.findall(text)] for text in (ends, shown))
    assert here == pytest.approx(there, rel=0.1)


def test_its_log_can_be_taken_by_every_command(demo_run, tmp_path):
    _, out = demo_run
    log, validation = out / "log.csv", out / "validation.csv"
    result = antidrive("predict", out / "model.json", log, "--out", tmp_path / "p.csv", "--json")
    assert json.loads(result.out)["runs"][0]["rms"] < 1e-3
    found = fit(log, read_model(out / "base-model.json").model)
    base = json.loads((out / "base-model.json").read_text())["parameters"]
    assert found["inertia"].value == pytest.approx(base["inertia"]["value"], rel=1e-2)
    assert log_of(validation).runs[0].duration == pytest.approx(18.0, abs=0.1)


def test_ends_in_numbers_and_leaves_models_that_load(demo_run):
    result, out = demo_run
    for word in ("Synthetic", "Missing: cogging", "Prediction:", "Tracking:", "Preload:"):
        assert word in result.out
    files = ["base-model.json", "diagnosis.json", "log.csv", "model.json", "report.html", "summary.json"]
    assert sorted(listing(out)) == [*files, "validation.csv"]
    base, extended = read_model(out / "base-model.json").model, read_model(out / "model.json").model
    assert len(extended.effects) > len(base.effects)
    assert "synthetic" in (out / "report.html").read_text().lower()
