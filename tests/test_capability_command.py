"""The command `capability`: a table that is the map, a page that stands alone, and words with the right numbers."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from front_door import antidrive, listing

from allocation import Allocator, capability_map
from antidrive.figures import capability_figure
from antidrive.html_page import printed
from plant.gears import GearTrain

MOST = 161 / 20 * (0.25 - 0.01)
"""Output torque at rest with the limits below."""


@pytest.fixture(scope="module")
def command_result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("map") / "out"
    words = ("--inertia", 1.5, "--min-torque", 0.01, "--max-torque", 0.25, "--rotor-inertia", "1e-5")
    return folder, antidrive("capability", *words, "--out", folder, "--json")


def test_the_table_is_the_map(command_result):
    folder, result = command_result
    assert result.code == 0, result.err
    assert sorted(listing(folder)) == ["capability.csv", "report.html"]
    table = pd.read_csv(folder / "capability.csv")
    assert list(table.columns) == ["acceleration", "load_torque", "least_preload", "margin", "copper_loss"]
    a, load = np.unique(table.acceleration), np.unique(table.load_torque)
    allocator = Allocator(GearTrain.paper(), min_torque=0.01, max_torque=0.25, rotor_inertia=1e-5)
    found = capability_map(allocator, inertia=1.5, acceleration=a, load_torque=load)
    for name in ("least_preload", "margin", "copper_loss"):
        drawn = table[name].to_numpy().reshape(a.size, load.size)
        np.testing.assert_allclose(drawn, getattr(found, name), atol=1e-8)


def test_the_numbers_are_those_of_the_map(command_result):
    reported = json.loads(command_result[1].out)
    assert reported["load_torque_at_rest"] == pytest.approx([-MOST, MOST])
    assert reported["acceleration_without_load"] == pytest.approx([-MOST / 1.5, MOST / 1.5])
    assert reported["least_preload_at_rest"] == pytest.approx(0.01 / 20)
    assert reported["copper_loss_at_rest"] == pytest.approx(2 * 0.01**2)


def test_words_and_page_agree(tmp_path):
    result = antidrive("capability", "--max-torque", "0.25", "--min-torque", "0.01", "--out", tmp_path)
    assert f"from -{MOST:.4g} to {MOST:.4g} N m at rest" in result.out
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert printed(f"from -{MOST:.4g} to {MOST:.4g} N m at rest") in page
    assert "least preload [N m per tooth]" in page


def test_the_figure_leaves_out_what_is_out_of_reach():
    allocator = Allocator(GearTrain.paper(), min_torque=0.02, max_torque=0.3)
    found = capability_map(allocator, inertia=2.0, acceleration=[-1.0, 0.0, 1.0], load_torque=[-1.0, 0.0, 2.0])
    drawn = [row["map"] for row in capability_figure(found).to_dict()["rows"]]
    assert len(drawn) == 3
    for trace, values in zip(drawn, (found.least_preload, found.margin, found.copper_loss), strict=True):
        expected = np.where(found.reachable, values, np.nan)
        np.testing.assert_allclose(np.asarray(trace["z"], dtype=float), expected, rtol=1e-3)
        assert np.isnan(expected[2, 2])
        assert trace["x"] == [-1.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--inertia", "0"), "inertia"),
        (("--inertia", "nan"), "inertia"),
        (("--min-torque", "1"), "min_torque"),
        (("--min-torque", "0.3"), "takes all of max_torque"),
        (("--motor-friction", "5"), "takes all of max_torque"),
        (("--rotor-inertia", "-1"), "rotor_inertia"),
    ],
)
def test_what_cannot_be_mapped_is_reported_in_one_sentence(tmp_path, words, message):
    result = antidrive("capability", *words, "--out", tmp_path / "out")
    assert result.code == 2
    assert message in result.err
    assert result.err.count("\n") == 1
    assert not (tmp_path / "out").exists()
