"""A known model beside a new log: what moved, what is new."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import pytest
from front_door import TRUTH, antidrive, columns, listing, write_csv, write_model

import antidrive as ad
from antidrive.comparison_page import change_bars
from antidrive.model_comparison import Change
from plant.effects import Cogging, InputDelay
from plant.model_file import ModelFile

DURATION = 12.0
STD = {name: 1e-4 for name in TRUTH.names}
WORN = replace(TRUTH, viscous_friction=0.6).with_effect(Cogging(amplitude=0.15, order=8.0, phase=0.3))


def test_wear_and_a_new_effect_are_distinguished():
    log = columns(WORN, seed=2, duration=DURATION)
    found = ad.compare(ModelFile(model=TRUTH, std=STD), log, candidates=["cogging"])
    assert found.new == ("cogging",)
    assert [change.name for change in found.changes if change.moved] == ["viscous_friction"]
    frame = found.to_frame()
    assert frame.loc["viscous_friction", "after"] == pytest.approx(0.6, rel=0.01)
    assert frame.loc["viscous_friction", "errors"] > 20.0
    assert found.error_after < 0.1 * found.error_before
    lines = found.sentences()
    assert lines[0].startswith("Changed: viscous_friction: 0.50000 ± 0.00010 N m s/rad -> 0.")
    assert "+20 %" in lines[0]
    assert lines[1] == "New: cogging, probability above 0.99"


def test_what_is_not_certain_is_not_reported_as_new():
    """Where another effect does the same in this log, neither is new for sure: the machine is not stopped for it."""
    late = TRUTH.with_effect(InputDelay(time=0.004))
    log = columns(late, seed=2, duration=DURATION)
    found = ad.compare(ModelFile(model=TRUTH, std=STD), log, candidates=["sensor_lag", "input_delay", "actuator_lag"])
    unsure = [cause.effect for cause in found.diagnosis.causes if cause.probability <= 0.9]
    assert unsure
    assert found.possible == tuple(unsure)
    assert found.new == ()
    assert any(line.startswith("Perhaps new: ") for line in found.sentences())
    assert "No effect is new." not in found.sentences()
    assert "New" not in found.headline()
    assert found.to_dict()["possible"] == unsure


def test_the_command_reports_that_nothing_changed(tmp_path):
    model, out = tmp_path / "model.json", tmp_path / "out"
    ModelFile(model=TRUTH, std=STD).write(model)
    log = write_csv(tmp_path / "log.csv", columns(TRUTH, seed=3, duration=DURATION))
    result = antidrive("compare", model, log, "--candidates", "cogging", "--out", out)
    assert result.code == 0, result.err
    assert result.out.splitlines()[:2] == ["No parameter has changed beyond its error.", "No effect is new."]
    assert sorted(listing(out)) == ["comparison.csv", "comparison.json", "model.json", "report.html"]
    content = json.loads((out / "comparison.json").read_text())
    assert [entry["name"] for entry in content["changes"]] == list(TRUTH.names)
    assert not any(entry["moved"] for entry in content["changes"])


def test_a_change_is_reported_in_a_line():
    known = {"name": "inertia", "unit": "kg m^2", "before": 0.5, "before_std": 0.01, "moved": False}
    assert str(Change(**known, after=0.55, after_std=0.01)) == (
        "inertia: 0.500 ± 0.010 kg m^2 -> 0.550 ± 0.010 kg m^2 (+10 %, 3.5 standard errors)"
    )
    assert (
        str(Change(**known, after=None, after_std=None))
        == "inertia: this log does not determine it (it was 0.5 kg m^2)"
    )


def test_the_command_reports_what_is_wrong(tmp_path):
    model = write_model(tmp_path / "model.json", TRUTH)
    for words in ((tmp_path / "absent.json", "log.csv"), (model, tmp_path / "absent.csv")):
        result = antidrive("compare", *words, "--out", tmp_path / "out")
        assert (result.code, result.err.count("\n")) == (2, 1)
        assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("share", "moved"), [(0.003, []), (0.03, ["viscous_friction"])])
def test_a_change_below_a_hundredth_is_none(share: float, moved: list[str]) -> None:
    log = columns(TRUTH, seed=2, duration=DURATION)
    known = replace(TRUTH, viscous_friction=TRUTH.viscous_friction * (1.0 + share))
    found = ad.compare(ModelFile(model=known, std=dict.fromkeys(STD, 1e-6)), log, candidates=["cogging"])
    (change,) = (each for each in found.changes if each.name == "viscous_friction")
    assert abs(change.errors or 0.0) > 4.0
    assert [each.name for each in found.changes if each.moved] == moved


def test_a_small_change_does_not_fill_the_bar():
    within = {"unit": "N m", "before": 1.0, "before_std": 0.1, "after_std": 0.1, "moved": False}
    log = columns(TRUTH, seed=3, duration=DURATION)
    found = ad.compare(ModelFile(model=TRUTH, std=STD), log, candidates=["cogging"])
    bars = change_bars(replace(found, changes=(Change(name="gravity", after=1.1, **within),)))
    assert bars.bars[0].length < 0.3 * bars.full


def test_an_error_without_a_cause_is_reported_with_its_size():
    log = columns(TRUTH, seed=3, duration=DURATION)
    found = ad.compare(ModelFile(model=TRUTH, std=STD), log, candidates=["cogging"])
    unknown = replace(found, diagnosis=replace(found.diagnosis, verdict="unknown"), new=(), possible=())
    assert unknown.headline() == "A model error that no effect explains"
    (line,) = (line for line in unknown.sentences() if "no effect explains" in line)
    assert re.search(r"perhaps from the start: .* of the torque in the log\.$", line)
